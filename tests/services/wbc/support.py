"""States and set-points under the test's control."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.robot import frames, joints
from common.schemas import (
    Gait,
    GaitRequest,
    Header,
    OperatorClaim,
    OperatorKind,
    PlantState,
    Sender,
    Setpoint,
)
from services.wbc.qp import QpData
from services.wbc.robot_model import RobotState

Array = NDArray[np.float64]

G = joints.MOTOR_TO_JOINT
GAITS = tuple(gait for gait in Gait if gait is not Gait.NONE)
MS = 1_000_000
OPERATOR = Sender("teleop", 1)


def make_state(
    base_position: Array,
    base_quaternion: Array,
    joint_position: Array,
    base_twist: Array | None = None,
    joint_velocity: Array | None = None,
    stamp: int = 0,
    reset_count: int = 0,
) -> PlantState:
    """Standing on both feet; ``base_twist``: linear in world, angular in body, as on the bus."""
    twist = np.zeros(6) if base_twist is None else base_twist
    return PlantState(
        header=Header(stamp=stamp),
        base_position=base_position,
        base_quaternion=base_quaternion,
        base_linear_velocity=twist[:3],
        base_angular_velocity=twist[3:],
        joint_position=joint_position,
        joint_velocity=np.zeros(27) if joint_velocity is None else joint_velocity,
        joint_torque=np.zeros(27),
        gripper_closure=np.zeros(2),
        foot_normal_force=np.full(2, 180.0),
        reset_count=reset_count,
    )


def nominal_state(stamp: int = 0, height: float = 0.74, reset_count: int = 0) -> PlantState:
    """Crouching at rest at the origin, soles about on z = 0."""
    return make_state(
        np.array([0.0, 0.0, height]),
        np.array([1.0, 0.0, 0.0, 0.0]),
        joints.NOMINAL_POSITION,
        stamp=stamp,
        reset_count=reset_count,
    )


def random_states(count: int, seed: int) -> list[PlantState]:
    """Any base pose and twist, joints within their limits, both halves of a knee alike."""
    rng = np.random.default_rng(seed)
    motors = list(joints.MOTOR_POSITION_INDEX)
    states = []
    for _ in range(count):
        quaternion = rng.normal(size=4)
        position = rng.uniform(joints.POSITION_LOWER[motors], joints.POSITION_UPPER[motors])
        states.append(
            make_state(
                rng.uniform(-2.0, 2.0, 3),
                quaternion / np.linalg.norm(quaternion),
                G @ position,
                rng.normal(size=6),
                G @ (2.0 * rng.normal(size=25)),
            )
        )
    return states


def full_velocity(reduced: Array) -> Array:
    """(33,) velocity, base then joints, of a reduced (31,) one: both knee halves turn alike."""
    return np.concatenate((reduced[:6], G @ reduced[6:]))


def reduced_velocity(state: RobotState) -> Array:
    """(31,) base twist and motor rates."""
    motors = list(joints.MOTOR_POSITION_INDEX)
    return np.concatenate((state.velocity[:6], state.velocity[6:][motors]))


def setpoint(
    left: Array | None = None,
    right: Array | None = None,
    closure: tuple[float, float] = (0.0, 0.0),
    neck: float = 0.0,
    sender: Sender = OPERATOR,
) -> Setpoint:
    """Hands pointing ahead at the given places in the body frame, by default the nominal ones."""
    places = [np.array(frames.NOMINAL_HAND_IN_BODY[side]) for side in ("left", "right")]
    ahead = np.array(frames.FORWARD_HAND_IN_BODY)
    return Setpoint(
        header=Header(source=sender.source, boot=sender.boot),
        left_hand_position_in_body=places[0] if left is None else left,
        left_hand_quaternion_in_body=ahead,
        right_hand_position_in_body=places[1] if right is None else right,
        right_hand_quaternion_in_body=ahead,
        gripper_closure=np.array(closure),
        neck_pitch=neck,
    )


def request(
    request_id: int, gait: Gait = Gait.FORWARD, sender: Sender = OPERATOR, controller_boot: int = 0
) -> GaitRequest:
    header = Header(source=sender.source, boot=sender.boot)
    return GaitRequest(
        header=header, request_id=request_id, gait=gait, controller_boot=controller_boot
    )


def claim(
    seq: int,
    sender: Sender = OPERATOR,
    kind: OperatorKind = OperatorKind.SCRIPT,
    *,
    wants: bool = True,
    act: int = 1,
    holding: bool = True,
) -> OperatorClaim:
    """By default one that believes to have the robot, so that a new controller gives it at once."""
    header = Header(seq=seq, source=sender.source, boot=sender.boot)
    return OperatorClaim(header=header, kind=kind, wants=wants, act=act, holding=holding)


def copy_qp(data: QpData) -> QpData:
    """The builder reuses its arrays; a copy stays."""
    return replace(data, **{name: value.copy() for name, value in vars(data).items()})
