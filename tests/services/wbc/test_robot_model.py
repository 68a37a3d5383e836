"""The reduced model against the full one and against finite differences."""

import numpy as np
import pinocchio as pin
import pytest

from common.robot import frames, joints
from common.robot.rotations import rotation_vector_from_matrix
from services.wbc.errors import ModelError
from services.wbc.layout import COM, FEET, HANDS, NV, SIDES
from services.wbc.robot_model import Dynamics, FramePose, RobotModel, RobotState

from .support import Array, G, full_velocity, nominal_state, random_states, reduced_velocity

STATES = 20
STEP = 1e-6
TOLERANCE = 1e-7  # absolute; quantities are of order 1, the differences err by STEP²
G_FULL = np.block([[np.eye(6), np.zeros((6, 25))], [np.zeros((27, 6)), G]])
"""(33, 31) v = G v_r."""


@pytest.fixture(scope="module")
def states() -> list[RobotState]:
    return [RobotState.from_plant(state) for state in random_states(STATES, seed=41)]


def _moved(model: RobotModel, state: RobotState, reduced: Array) -> RobotState:
    """The state displaced along a reduced velocity for one second, with the same velocity."""
    position = pin.integrate(model.model, state.position, full_velocity(reduced))
    return RobotState(position, state.velocity)


def _rotation_rate(after: Array, before: Array) -> Array:
    return rotation_vector_from_matrix(after @ before.T) / (2.0 * STEP)


FRAMES = ("left foot", "right foot", "left hand", "right hand")
ROWS = dict(zip(FRAMES, (*FEET, *HANDS), strict=True))


def _frame(dynamics: Dynamics, name: str) -> FramePose:
    return (*dynamics.feet, *dynamics.hands)[FRAMES.index(name)]


def _difference_jacobian(model: RobotModel, state: RobotState, name: str) -> Array:
    columns = np.zeros((6, NV))
    for i, unit in enumerate(np.eye(NV)):
        ahead = _frame(model.update(_moved(model, state, STEP * unit)), name)
        behind = _frame(model.update(_moved(model, state, -STEP * unit)), name)
        columns[:3, i] = (ahead.position - behind.position) / (2.0 * STEP)
        columns[3:, i] = _rotation_rate(ahead.rotation, behind.rotation)
    return columns


def test_reduced_dynamics_are_the_projected_full_ones(
    model: RobotModel, states: list[RobotState]
) -> None:
    data = model.model.createData()
    for state in states:
        dynamics = model.update(state)
        mass = pin.crba(model.model, data, state.position)
        mass = np.triu(mass) + np.triu(mass, 1).T
        force = pin.rnea(model.model, data, state.position, state.velocity, np.zeros(33))
        assert np.abs(dynamics.mass_matrix - G_FULL.T @ mass @ G_FULL).max() < 1e-12
        assert np.abs(dynamics.bias_force - G_FULL.T @ force).max() < 1e-10
        assert np.array_equal(dynamics.mass_matrix, dynamics.mass_matrix.T)


def test_mass_matrix_holds_the_rotor_inertia(model: RobotModel) -> None:
    dynamics = model.update(RobotState.from_plant(nominal_state()))
    diagonal = dict(zip(joints.MOTOR_NAMES, dynamics.mass_matrix.diagonal()[6:], strict=True))
    # The bare links give 0.00185 and 0.00244 kg·m²; the rotors add 0.01.
    assert diagonal["l_ankle_ie"] == pytest.approx(0.00185 + 0.01, abs=1e-5)
    assert diagonal["l_wrist_ps"] == pytest.approx(0.00244 + 0.01, abs=1e-5)
    assert model.mass == pytest.approx(36.5222, abs=1e-3)
    # The coordinate of a knee turns two rotors.
    bare = model.model.copy()
    bare.armature = np.zeros(33)
    light = pin.crba(bare, bare.createData(), RobotState.from_plant(nominal_state()).position)
    light = np.triu(light) + np.triu(light, 1).T
    knees = (G_FULL.T @ light @ G_FULL).diagonal()[6:]
    assert diagonal["l_knee"] - knees[joints.MOTOR_NAMES.index("l_knee")] == pytest.approx(0.02)


@pytest.mark.parametrize("name", FRAMES)
def test_frame_jacobian_against_differences(
    model: RobotModel, states: list[RobotState], name: str
) -> None:
    for state in states:
        jacobian = model.update(state).jacobian[ROWS[name]]
        assert np.abs(jacobian - _difference_jacobian(model, state, name)).max() < TOLERANCE


def test_com_jacobian_against_differences(model: RobotModel, states: list[RobotState]) -> None:
    for state in states:
        jacobian = model.update(state).jacobian[COM]
        for i, unit in enumerate(np.eye(NV)):
            ahead = model.update(_moved(model, state, STEP * unit)).com_position
            behind = model.update(_moved(model, state, -STEP * unit)).com_position
            assert np.abs((ahead - behind) / (2.0 * STEP) - jacobian[:, i]).max() < TOLERANCE


def test_sole_jacobian_carries_power(model: RobotModel, states: list[RobotState]) -> None:
    """J' f does the work that f, expressed in the sole, does on the sole's own velocity."""
    rng = np.random.default_rng(7)
    for state in states:
        dynamics = model.update(state)
        reduced = reduced_velocity(state)
        for side, foot in enumerate(dynamics.feet):
            wrench = rng.normal(size=6)
            ahead = model.update(_moved(model, state, STEP * reduced)).feet[side]
            behind = model.update(_moved(model, state, -STEP * reduced)).feet[side]
            linear = (ahead.position - behind.position) / (2.0 * STEP)
            angular = _rotation_rate(ahead.rotation, behind.rotation)
            power = wrench[:3] @ foot.rotation.T @ linear + wrench[3:] @ foot.rotation.T @ angular
            jacobian = dynamics.sole_jacobians[side]
            assert wrench @ jacobian @ reduced == pytest.approx(power, abs=1e-5)


def test_velocities_against_differences(model: RobotModel, states: list[RobotState]) -> None:
    for state in states:
        reduced = reduced_velocity(state)
        dynamics = model.update(state)
        ahead = model.update(_moved(model, state, STEP * reduced))
        behind = model.update(_moved(model, state, -STEP * reduced))
        for name in FRAMES:
            after, before = (_frame(d, name) for d in (ahead, behind))
            linear = (after.position - before.position) / (2.0 * STEP)
            angular = _rotation_rate(after.rotation, before.rotation)
            velocity, jacobian = dynamics.velocity[ROWS[name]], dynamics.jacobian[ROWS[name]]
            assert np.abs(velocity - np.concatenate((linear, angular))).max() < 1e-6
            assert np.abs(velocity - jacobian @ reduced).max() < 1e-12
        moved = (ahead.com_position - behind.com_position) / (2.0 * STEP)
        assert np.abs(dynamics.com_velocity - moved).max() < 1e-6
        assert np.abs(dynamics.com_velocity - dynamics.jacobian[COM] @ reduced).max() < 1e-12


@pytest.mark.parametrize("name", FRAMES)
def test_frame_bias_against_differences(
    model: RobotModel, states: list[RobotState], name: str
) -> None:
    for state in states:
        bias, rows = model.update(state).bias[ROWS[name]], ROWS[name]
        reduced = reduced_velocity(state)
        ahead = model.update(_moved(model, state, STEP * reduced)).velocity[rows]
        behind = model.update(_moved(model, state, -STEP * reduced)).velocity[rows]
        assert np.abs((ahead - behind) / (2.0 * STEP) - bias).max() < 1e-6 * (1 + abs(bias).max())


def test_com_bias_against_differences(model: RobotModel, states: list[RobotState]) -> None:
    for state in states:
        bias, reduced = model.update(state).bias[COM], reduced_velocity(state)
        ahead = model.update(_moved(model, state, STEP * reduced)).com_velocity
        behind = model.update(_moved(model, state, -STEP * reduced)).com_velocity
        assert np.abs((ahead - behind) / (2.0 * STEP) - bias).max() < 1e-6 * (1 + abs(bias).max())


def test_torso_turns_as_its_body_velocity_says(model: RobotModel, states: list[RobotState]) -> None:
    """The torso task's rows are R, and R w_body has no Jdot v: its rate is R wdot_body."""
    for state in states:
        reduced = reduced_velocity(state)
        ahead = _moved(model, state, STEP * reduced)
        behind = _moved(model, state, -STEP * reduced)
        after, before = (model.update(s).base_rotation.copy() for s in (ahead, behind))
        dynamics = model.update(state)
        omega = dynamics.base_rotation @ dynamics.base_twist[3:]
        assert np.abs(_rotation_rate(after, before) - omega).max() < TOLERANCE
        twist = dynamics.base_twist[3:]
        assert np.abs((after @ twist - before @ twist) / (2.0 * STEP)).max() < 1e-6


def test_hands_do_not_feel_the_base(model: RobotModel, states: list[RobotState]) -> None:
    rng = np.random.default_rng(3)
    for state in states:
        before = model.update(state)
        base = np.concatenate((rng.normal(size=6), np.zeros(25)))
        moved = _moved(model, state, base)
        velocity = state.velocity.copy()
        velocity[:6] = rng.normal(size=6)
        after = model.update(RobotState(moved[0], velocity))
        for hand, same, rows in zip(before.hands, after.hands, HANDS, strict=True):
            assert not before.jacobian[rows, :6].any()
            assert np.abs(hand.position - same.position).max() < 1e-12
            assert np.abs(hand.rotation - same.rotation).max() < 1e-12
            assert np.abs(before.jacobian[rows] - after.jacobian[rows]).max() < 1e-12
            assert np.abs(before.velocity[rows] - after.velocity[rows]).max() < 1e-12
            assert np.abs(before.bias[rows] - after.bias[rows]).max() < 1e-11


def test_hand_positions_at_the_nominal_crouch(model: RobotModel) -> None:
    dynamics = model.update(RobotState.from_plant(nominal_state()))
    for side, hand in zip(SIDES, dynamics.hands, strict=True):
        assert np.abs(hand.position - frames.NOMINAL_HAND_IN_BODY[side]).max() < 1e-6


def test_plant_state_becomes_a_body_twist() -> None:
    state = random_states(1, seed=5)[0]
    converted = RobotState.from_plant(state)
    rotation = pin.Quaternion(converted.position[3:7]).toRotationMatrix()
    assert np.abs(rotation @ converted.velocity[:3] - state.base_linear_velocity).max() < 1e-14
    assert np.array_equal(converted.velocity[3:6], state.base_angular_velocity)
    w, x, y, z = state.base_quaternion
    assert np.abs(converted.position[3:7] - (x, y, z, w)).max() < 1e-15


def test_update_leaves_earlier_results_alone(model: RobotModel) -> None:
    first, second = (RobotState.from_plant(s) for s in random_states(2, seed=9))
    dynamics = model.update(first)
    kept = [np.copy(a) for a in _arrays(dynamics)]
    model.update(second)
    for before, after in zip(kept, _arrays(dynamics), strict=True):
        assert np.array_equal(before, after)


def _arrays(dynamics: Dynamics) -> list[Array]:
    plain = [a for a in dynamics if isinstance(a, np.ndarray)]
    return [*plain, *(a for frame in (*dynamics.feet, *dynamics.hands) for a in frame)]


def test_other_joint_order_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    names = list(joints.JOINT_NAMES)
    names[0], names[1] = names[1], names[0]
    monkeypatch.setattr(joints, "JOINT_NAMES", tuple(names))
    with pytest.raises(ModelError, match=r"expected \('l_hip_aa', 'l_hip_ie'"):
        RobotModel()


def test_missing_frame_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "FOOT_FRAMES", {"left": "l_paw", "right": "r_foot"})
    with pytest.raises(ModelError, match=r"no frame 'l_paw'.*l_foot"):
        RobotModel()
