"""Computes the poses of the robot's links and their shapes with MuJoCo."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.robot.frames import BODY_FRAME, FOOT_FRAMES, HAND_FRAMES
from common.robot.joints import FINGER_JOINTS, GRIPPER_STROKE, JOINT_NAMES, MJCF_PATH
from services.logger.export.meshes import LinkMesh, link_meshes

Array = NDArray[np.float64]

EYES = ("left", "right")
"""Names of the stereo pair's cameras, the left one first."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame in its parent: position (3,) [m] and quaternion (4,) w, x, y, z."""

    name: str
    parent: str
    position: Array
    quaternion: Array


@dataclass(frozen=True, slots=True)
class Lens:
    """An ideal pinhole camera.

    ``field_of_view`` is the vertical one [rad], ``baseline`` how far right of the left eye [m].
    """

    field_of_view: float
    baseline: float


def camera_frame(eye: str) -> str:
    """Return the name of the frame of an eye's images: x right, y down, z ahead."""
    return f"{eye}_camera"


class RobotModel:
    """Forward kinematics of all links, hands, feet and cameras below ``torso_link``."""

    def __init__(self) -> None:
        """Load the model.

        Raises:
            ImportError: MuJoCo is not installed.
        """
        import mujoco

        self._mujoco: Any = mujoco
        self._model: Any = mujoco.MjModel.from_xml_path(str(MJCF_PATH))
        self._data: Any = mujoco.MjData(self._model)
        self._joints = self._addresses(JOINT_NAMES)
        self._fingers = [self._addresses(FINGER_JOINTS[side]) for side in ("left", "right")]
        # With the torso at the origin, all poses are in the body frame.
        self._data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        torso = self._model.body(BODY_FRAME).id
        self._links = [
            (body, int(self._model.body_parentid[body]))
            for body in range(self._model.nbody)
            if body not in {0, torso}
        ]
        self._sites = [
            self._model.site(name).id for name in (*HAND_FRAMES.values(), *FOOT_FRAMES.values())
        ]

        self._cameras = [self._camera(eye) for eye in EYES]

    def lens(self, eye: str) -> Lens:
        """Return the camera of the ``left`` or ``right`` eye."""
        here, first = (self._model.camera(name) for name in (eye, EYES[0]))
        baseline = float(np.linalg.norm(here.pos - first.pos))
        return Lens(float(np.radians(here.fovy[0])), baseline)

    def meshes(self) -> list[LinkMesh]:
        """Return the shapes of every link, in its frame."""
        return link_meshes(self._model)

    def place(self, joints: Array, gripper_closure: Array) -> None:
        """Set ``joints`` (27,) [rad] and ``gripper_closure`` (2,), 1 is closed."""
        self._data.qpos[self._joints] = joints
        for addresses, closure in zip(self._fingers, gripper_closure.tolist(), strict=True):
            self._data.qpos[addresses] = GRIPPER_STROKE * (1.0 - closure)
        self._mujoco.mj_kinematics(self._model, self._data)

    def frames(self) -> list[Frame]:
        """Return every link in its parent; hands, feet, cameras in the link they are fixed to."""
        data, model = self._data, self._model
        links = [
            self._relative(model.body(body).name, parent, data.xpos[body], data.xquat[body])
            for body, parent in self._links
        ]
        sites = [
            self._relative(
                model.site(site).name,
                int(model.site_bodyid[site]),
                data.site_xpos[site],
                self._site_quaternion(site),
            )
            for site in self._sites
        ]
        return links + sites + self._cameras

    def in_body(self, site: str) -> tuple[Array, Array]:
        """Return position (3,) [m] and quaternion (4,) of a site in ``torso_link``."""
        number = self._model.site(site).id
        return self._data.site_xpos[number].copy(), self._site_quaternion(number)

    def _addresses(self, names: tuple[str, ...]) -> list[int]:
        return [int(self._model.joint(name).qposadr[0]) for name in names]

    def _camera(self, eye: str) -> Frame:
        camera = self._model.camera(eye)
        quaternion = np.zeros(4)
        # MuJoCo's cameras look along -z with y up; images are described with z ahead and y down.
        self._mujoco.mju_mulQuat(quaternion, camera.quat, np.array([0.0, 1.0, 0.0, 0.0]))
        parent = self._model.body(int(camera.bodyid[0])).name
        return Frame(camera_frame(eye), parent, camera.pos.copy(), quaternion)

    def _site_quaternion(self, site: int) -> Array:
        quaternion = np.zeros(4)
        self._mujoco.mju_mat2Quat(quaternion, self._data.site_xmat[site])
        return quaternion

    def _relative(self, name: str, parent: int, position: Array, quaternion: Array) -> Frame:
        inverse, shift, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        self._mujoco.mju_negQuat(inverse, self._data.xquat[parent])
        offset = position - self._data.xpos[parent]
        self._mujoco.mju_rotVecQuat(shift, offset, inverse)
        self._mujoco.mju_mulQuat(turn, inverse, quaternion)
        parent_name = self._model.body(parent).name
        return Frame(name, parent_name, shift, turn)
