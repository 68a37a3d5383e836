"""Distances of the arms from each other and from the body, and how the joints change them.

The shapes are the MJCF's own collision geoms, found by name, so that the controller keeps apart
what the plant would let collide. Geoms of one link that form one part are wrapped in their convex
hull; the fingers are in the middle of their stroke.
"""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from common.robot import joints
from common.robot.frames import COLLISION_SUFFIX
from common.schemas.arrays import Float64Array as Array
from services.wbc.errors import ModelError
from services.wbc.layout import ARM_COLUMNS, NV

JOINTS_OF_MOTORS = np.zeros((6 + joints.NUM_JOINTS, NV))
JOINTS_OF_MOTORS[:6, :6], JOINTS_OF_MOTORS[6:, 6:] = np.eye(6), joints.MOTOR_TO_JOINT
"""(33, 31) v = G v_r."""
FLOATING = 1
"""Index of the floating base among the joints; it moves all parts alike."""
REACH = 0.06
"""Distance up to which a pair of parts is reported [m]."""
UPPER_ARM_REACH = 0.035
"""The same for an upper arm, which is 0.05 m from the trunk when the arm hangs, but is slow [m]."""
HULLS = {
    "trunk": ("chest", "pelvis", "yoke"),
    **{f"{side}_hand": tuple(f"{side}_{part}" for part in ("palm", "finger_a", "finger_b"))
       for side in "lr"},
}  # fmt: skip
"""Parts that are made of several boxes of one link."""
ENDS = ("forearm", "wrist", "hand")
"""Parts of an arm below its elbow."""
PAIRS = (
    *product([f"l_{part}" for part in ENDS], [f"r_{part}" for part in ENDS]),
    *((f"{side}_{part}", "trunk")
      for side in "lr" for part in ("upper_arm", "elbow_motor", *ENDS)),
    *((f"{side}_{part}", f"{side}_hip_motor") for side in "lr" for part in ENDS),
)  # fmt: skip
"""Parts that are kept apart."""


class Clearance(NamedTuple):
    """The k pairs of parts that are within reach.

    Attributes:
        pairs: their names.
        distance: (k,) between the nearest points; negative where parts overlap [m].
        rate: (k,) of change [m/s].
        jacobian: (k, 31) of ``rate`` by the velocity of the arms; zero in the other columns. The
            base moves all parts alike, and the legs shall not make way for an arm.
    """

    pairs: list[tuple[str, str]]
    distance: Array
    rate: Array
    jacobian: Array


_NOTHING_NEAR = Clearance([], np.zeros(0), np.zeros(0), np.zeros((0, NV)))


class ClearanceModel:
    """Measures the distances of :data:`PAIRS`.

    Args:
        model: the robot with locked fingers and merged knees.
        geometry: its collision geoms.

    Attributes:
        levers: (pairs, 27) no joint changes the distance of a pair faster than this [m].

    Raises:
        ModelError: a geom is missing.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel) -> None:
        self._model, self._geometry = model, geometry
        for name, parts in HULLS.items():
            self._add_hull(name, parts)
        moved, levers = [], []
        for pair in PAIRS:
            first, second = (self._index(part) for part in pair)
            geometry.addCollisionPair(pin.CollisionPair(first, second))
            one, other = self._levers_of(first), self._levers_of(second)
            moved.append(np.sign(other) - np.sign(one))
            levers.append((one + other) * np.abs(moved[-1]))
        self._moved, self.levers = np.array(moved), np.array(levers)[:, 6:]
        self._data = geometry.createData()
        self._reach = np.array(
            [UPPER_ARM_REACH if "upper" in first else REACH for first, _ in PAIRS]
        )
        # Distances when last measured, and the joints' positions then.
        self._measured = np.zeros(len(PAIRS))
        self._position = np.zeros((len(PAIRS), joints.NUM_JOINTS))
        # The pairs that the legs move too, and the others: none of them comes within reach before
        # the joints have turned far enough from where all were checked.
        legs = self.levers[:, : joints.LEFT_ARM.start].any(axis=1)
        self._groups = (np.flatnonzero(legs), np.flatnonzero(~legs))
        self._longest_levers = np.array([self.levers[g].max(axis=0) for g in self._groups])
        self._checked, self._far = np.zeros(joints.NUM_JOINTS), np.zeros(2)

    def _index(self, part: str) -> int:
        name = part + COLLISION_SUFFIX
        if not self._geometry.existGeometryName(name):
            known = sorted(shape.name for shape in self._geometry.geometryObjects)
            raise ModelError(f"the MJCF has no geom {name!r}; it has {known}")
        return int(self._geometry.getGeometryId(name))

    def _add_hull(self, name: str, parts: Sequence[str]) -> None:
        shapes = [self._geometry.geometryObjects[self._index(part)] for part in parts]
        corners = coal.StdVec_Vec3s()
        for shape in shapes:
            for signs in product((-1.0, 1.0), repeat=3):
                corners.append(shape.placement.act(np.array(signs) * shape.geometry.halfSide))
        hull = coal.Convex.convexHull(corners, False, "")
        parent = shapes[0].parentJoint
        part = pin.GeometryObject(name + COLLISION_SUFFIX, parent, pin.SE3.Identity(), hull)
        self._geometry.addGeometryObject(part)

    def _levers_of(self, index: int) -> Array:
        """Return how far from each joint (33,) that moves a geom its points can be; 0 for others.

        A point is at most as far as the links between are long, however they are bent [m].
        """
        geom = self._geometry.geometryObjects[index]
        geom.geometry.computeLocalAABB()
        centre = geom.placement.act(geom.geometry.aabb_center)
        lever = float(np.linalg.norm(centre)) + geom.geometry.aabb_radius
        levers, joint = np.zeros(6 + joints.NUM_JOINTS), geom.parentJoint
        while joint > FLOATING:
            levers[self._model.joints[joint].idx_vExtended] = lever
            lever += float(np.linalg.norm(self._model.jointPlacements[joint].translation))
            joint = self._model.parents[joint]
        return levers

    def update(self, data: pin.Data, position: Array, velocity: Array) -> Clearance:
        """Return the pairs within reach.

        Args:
            data: of the model, with placements and Jacobians at the present position.
            position: (34,) with both hinges of a knee.
            velocity: (31,) of the model.
        """
        perhaps = self._perhaps_near(position[7:])
        if not perhaps:
            return _NOTHING_NEAR
        pin.updateGeometryPlacements(self._model, data, self._geometry, self._data)
        near, lines = [], []
        for index in perhaps:
            result = pin.computeDistance(self._geometry, self._data, index)
            self._measured[index] = result.min_distance
            if result.min_distance < self._reach[index]:
                point, normal = result.getNearestPoint1(), result.normal
                near.append(index)
                lines.append((*normal, *pin.skew(point).dot(normal)))
        if not near:
            return _NOTHING_NEAR
        # Both nearest points lie on one line along the normal, of which these are the coordinates:
        # their product with a joint's axis is the velocity of either point along the normal.
        # Those of the model are of each hinge.
        jacobian = np.array(lines).dot(data.J) * self._moved[near]
        jacobian = jacobian.dot(JOINTS_OF_MOTORS)
        rate = jacobian.dot(velocity)
        jacobian[:, : ARM_COLUMNS.start] = 0.0
        return Clearance([PAIRS[i] for i in near], self._measured[near], rate, jacobian)

    def _perhaps_near(self, position: Array) -> list[int]:
        """Return the pairs that may have come within reach since they were last measured.

        To measure them all takes longer than all other terms of the model.
        """
        nearest = self._far - self._longest_levers.dot(np.abs(position - self._checked))
        if min(nearest.tolist()) > 0.0:
            return []
        approach = np.einsum("ij,ij->i", np.abs(position - self._position), self.levers)
        distance = self._measured - approach - self._reach
        self._checked, self._far = position, np.array([distance[g].min() for g in self._groups])
        perhaps = np.flatnonzero(distance < 0.0)
        self._position[perhaps] = position
        indices: list[int] = perhaps.tolist()
        return indices
