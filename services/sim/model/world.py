"""The MuJoCo model: robot, floor, lights, physics options and a scene."""

from copy import copy
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from common.plant.config import PHYSICS_RATE
from common.robot.frames import BODY_FRAME, FOOT_GEOMS
from common.robot.joints import (
    FINGER_JOINTS,
    GRIPPER_ACTUATORS,
    JOINT_NAMES,
    MJCF_PATH,
    MOTOR_NAMES,
    NUM_MOTORS,
)
from services.sim.errors import SceneError
from services.sim.scenes import find_scene
from services.sim.scenes.parts import KEY_LIGHT, VISUAL_GROUP

FLOOR_GEOM = "floor"
IMPRATIO = 20.0
"""Ratio of frictional to normal constraint impedance: feet and grasps creep without it."""

_FINGERS = tuple(name for names in FINGER_JOINTS.values() for name in names)
_QUATERNION = ("qw", "qx", "qy", "qz")
_QPOS_PARTS = {
    int(mujoco.mjtJoint.mjJNT_FREE): ("x", "y", "z", *_QUATERNION),
    int(mujoco.mjtJoint.mjJNT_BALL): _QUATERNION,
}
"""Names of the positions of a joint that has more than one, by its type."""
_FAINT_BLUE = [0.62, 0.72, 0.82]


def build_spec(scene: str = "flat", *, visuals: bool = True) -> Any:
    """Return the ``mujoco.MjSpec`` of robot, floor, lights and the named scene.

    Args:
        scene: its name.
        visuals: keep the visual geoms (group 2). Without them physics is the same and a seventh
            cheaper.

    Raises:
        SceneError: the scene is unknown.
    """
    spec = mujoco.MjSpec.from_file(str(MJCF_PATH))
    _set_physics(spec)
    _add_floor(spec)
    _add_lights(spec)
    of_robot = len(spec.joints)
    find_scene(scene).build(spec)
    if len(spec.joints) == of_robot:
        # A single tree is a single island, and its bodies have few geoms each: neither looking for
        # islands nor bounding the geoms of a body once more saves what it takes.
        bits = mujoco.mjtDisableBit
        spec.option.disableflags |= bits.mjDSBL_ISLAND | bits.mjDSBL_MIDPHASE
    if not visuals:
        for geom in [geom for geom in spec.geoms if geom.group == VISUAL_GROUP]:
            spec.delete(geom)
    return spec


def build_model(scene: str = "flat", *, visuals: bool = True) -> Any:
    """Return a new compiled ``mujoco.MjModel`` of :func:`build_spec`."""
    return copy(_compiled(scene, visuals))


@cache
def _compiled(scene: str, visuals: bool) -> Any:
    """Compile once a process: meshes take a few tenths of a second."""
    return build_spec(scene, visuals=visuals).compile()


def _set_physics(spec: Any) -> None:
    option = spec.option
    option.timestep = 1.0 / PHYSICS_RATE
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    # A diverged state must be reported, not silently replaced by the initial one.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _add_floor(spec: Any) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=_FAINT_BLUE,
        width=256,
        height=256 * 6,
    )
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.34, 0.39, 0.44],
        rgb2=[0.30, 0.35, 0.40],
        markrgb=[0.55, 0.60, 0.65],
        width=256,
        height=256,
    )
    floor = spec.add_material(name="floor", texuniform=True, texrepeat=[1.0, 1.0], reflectance=0.12)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    spec.worldbody.add_geom(
        name=FLOOR_GEOM,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.5],
        material="floor",
        friction=[1.0, 0.005, 0.0001],
    )


def _add_lights(spec: Any) -> None:
    visual = spec.visual
    visual.headlight.ambient = [0.34, 0.35, 0.37]
    visual.headlight.diffuse = [0.22, 0.22, 0.22]
    visual.headlight.specular = [0.0, 0.0, 0.0]
    visual.quality.shadowsize = 4096
    # The floor fades into the sky at zfar; beyond it lies nothing.
    visual.map.znear, visual.map.zfar = 0.02, 12.0
    visual.map.haze = 0.35
    # Twice as fine a shadow over half the cone, which still covers the robot's surroundings.
    visual.map.shadowscale = 0.5
    visual.rgba.haze = [0.86, 0.90, 0.94, 1.0]
    spec.stat.center = [0.0, 0.0, 0.7]
    spec.stat.extent = 2.0
    torso = spec.body(BODY_FRAME)
    # Tracking lights keep their place relative to the robot wherever it walks.
    torso.add_light(
        name=KEY_LIGHT,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        type=mujoco.mjtLightType.mjLIGHT_SPOT,
        pos=[1.8, 1.2, 4.5],
        dir=[-0.36, -0.24, -0.9],
        cutoff=60.0,
        exponent=1.0,
        diffuse=[0.64, 0.62, 0.58],
        specular=[0.25, 0.25, 0.25],
        castshadow=True,
    )
    torso.add_light(
        name="fill",
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-0.5, -2.5, 2.0],
        dir=[0.15, 0.77, -0.62],
        diffuse=[0.20, 0.22, 0.26],
        specular=[0.0, 0.0, 0.0],
        castshadow=False,
    )


@dataclass(frozen=True)
class Addresses:
    """Indices of the robot's quantities in MuJoCo's vectors.

    Attributes:
        qpos: (27,) indices of the joint positions in ``data.qpos``, canonical order.
        qvel: (27,) indices of the joint velocities in ``data.qvel``.
        fingers_qpos: (2, 2) finger slides in ``data.qpos``; rows left, right.
        grippers: (2,) gripper actuators in ``data.ctrl``; left, right.
        torso: body id.
        floor: geom id.
        feet: geom ids; left, right.
        scene: index in ``data.qpos`` of the first of the scene's joints, which come last.
    """

    qpos: NDArray[np.intp]
    qvel: NDArray[np.intp]
    fingers_qpos: NDArray[np.intp]
    grippers: NDArray[np.intp]
    torso: int
    floor: int
    feet: tuple[int, int]
    scene: int


def find_addresses(model: Any) -> Addresses:
    """Return the robot's indices in a compiled model.

    Raises:
        SceneError: the motors are not the model's first actuators in canonical order.
    """
    motors = tuple(model.actuator(i).name for i in range(NUM_MOTORS))
    if motors != MOTOR_NAMES:
        raise SceneError(
            f"expected the model's first {NUM_MOTORS} actuators to be the motors in canonical "
            f"order, got {motors}; add a scene's actuators after the robot's"
        )
    sides = ("left", "right")
    return Addresses(
        qpos=np.array([model.joint(n).qposadr[0] for n in JOINT_NAMES]),
        qvel=np.array([model.joint(n).dofadr[0] for n in JOINT_NAMES]),
        fingers_qpos=np.array(
            [[model.joint(n).qposadr[0] for n in FINGER_JOINTS[side]] for side in sides]
        ),
        grippers=np.array([model.actuator(GRIPPER_ACTUATORS[side]).id for side in sides]),
        torso=model.body(BODY_FRAME).id,
        floor=model.geom(FLOOR_GEOM).id,
        feet=(model.geom(FOOT_GEOMS["left"]).id, model.geom(FOOT_GEOMS["right"]).id),
        scene=1 + max(int(model.joint(n).qposadr[0]) for n in (*JOINT_NAMES, *_FINGERS)),
    )


def scene_names(model: Any, addresses: Addresses) -> list[str]:
    """Return a name for each of the scene's joint positions, in the order of ``qpos``.

    A hinge or slide is called as its joint; a free body as ``trolley.x``, ``trolley.qw`` and so on.
    """
    names: list[str] = []
    for index in range(model.njnt):
        joint = model.joint(index)
        if int(joint.qposadr[0]) < addresses.scene:
            continue
        name = joint.name or model.body(int(joint.bodyid[0])).name
        parts = _QPOS_PARTS.get(int(joint.type[0]))
        names += [f"{name}.{part}" for part in parts] if parts else [name]
    return names
