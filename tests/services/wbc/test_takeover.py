"""Taking over a robot that stands, or that was left on one leg."""

from itertools import pairwise

import numpy as np
import pytest

from common.schemas import ControlState, Gait, GaitOutcome
from services.wbc.config import WbcConfig
from services.wbc.references import UNLOADED
from services.wbc.robot_model import RobotModel

from .bench import Bench
from .ideal import IdealRobot

CONFIG = WbcConfig()


def _one_leg(model: RobotModel, side: int, height: float) -> IdealRobot:
    """A foot in the air, 50 mm ahead; the CoM over the inner half of the other sole."""
    robot = IdealRobot(model, CONFIG)
    position, yaw = robot.feet[side]
    robot.feet[side] = (position + np.array([0.05, 0.0, height]), yaw)
    robot.foot_force[side] = 0.0
    other = robot.feet[1 - side][0]
    robot.com = np.array([0.02, 0.75 * other[1], 0.68])
    return robot


SIDES = pytest.mark.parametrize(
    ("side", "swing"), [(0, ControlState.LF_SWING), (1, ControlState.RF_SWING)]
)


@SIDES
def test_a_raised_foot_is_put_down_first(model: RobotModel, side: int, swing: ControlState) -> None:
    robot = _one_leg(model, side, 0.04)
    standing = robot.feet[1 - side][0]
    before = robot.feet[side][0]
    robot.run(1.19)
    references = [reference for _, _, reference in robot.trace]
    assert {state for _, state, _ in robot.trace} == {swing}
    for reference in references:
        assert reference.normal_force_max[side] == UNLOADED
        assert reference.normal_force_max[1 - side] == 1000.0
        assert reference.swing[1 - side] is None
    # The CoM goes over the standing foot before the raised one moves, and stays there.
    assert np.abs(references[51].com[:2] - standing[:2]).max() < 1e-3
    half_way = references[51].swing[side]
    assert half_way is not None
    assert half_way.position[2] == pytest.approx(0.04, abs=1e-3)
    foot = robot.feet[side][0]
    assert foot == pytest.approx([*before[:2], 0.0], abs=1e-4)
    robot.run(1.1)
    _assert_stood_up(robot)


@SIDES
@pytest.mark.parametrize(("share", "speed"), [(0.35, 0.0), (0.75, 0.3)])
def test_a_raised_foot_is_put_down_at_once_if_the_robot_tips(
    model: RobotModel, side: int, swing: ControlState, share: float, speed: float
) -> None:
    """DCM 91 or 115 mm from the middle of a sole 65 mm wide: no time to bring it back."""
    robot = _one_leg(model, side, 0.04)
    other = robot.feet[1 - side][0]
    robot.com = np.array([0.02, share * other[1], 0.68])
    robot.com_velocity[1] = -speed * np.sign(other[1])
    robot.run(0.24)
    assert {state for _, state, _ in robot.trace} == {swing}
    references = [reference for _, _, reference in robot.trace]
    assert robot.feet[side][0][2] == pytest.approx(0.0, abs=2e-3)
    assert max(np.abs(reference.com - references[0].com).max() for reference in references) < 1e-9
    robot.run(0.03)
    assert robot.locomotion.state is ControlState.STAND
    # Loaded over 0.3 s, then both feet carry alike.
    assert 1.0 < robot.tick().normal_force_max[side] < 300.0
    robot.run(1.1)
    _assert_stood_up(robot)
    assert robot.trace[-1][2].normal_force_max == (1000.0, 1000.0)


def _assert_stood_up(robot: IdealRobot) -> None:
    states = [state for _, state, _ in robot.trace]
    assert states[-1] is ControlState.BALANCE
    middle, _ = robot.stance()
    assert np.abs(robot.com - (*middle, 0.70)).max() < 1e-3
    for a, b in pairwise(reference.com for _, _, reference in robot.trace):
        assert np.abs(b - a).max() < 0.006


@pytest.mark.parametrize(("height", "force"), [(0.01, 0.0), (0.04, 60.0)])
def test_a_foot_a_little_higher_or_loaded_stands(
    model: RobotModel, height: float, force: float
) -> None:
    robot = _one_leg(model, 0, height)
    robot.foot_force[0] = force
    robot.run(1.1)
    states = [state for _, state, _ in robot.trace]
    assert states[0] is ControlState.STAND
    assert states[-1] is ControlState.BALANCE


def test_no_gait_while_a_foot_is_put_down(model: RobotModel) -> None:
    robot = _one_leg(model, 1, 0.05)
    robot.run(0.3)
    robot.locomotion.request(1, Gait.FORWARD)
    robot.tick()
    assert "gaits start from BALANCE" in robot.answers[-1].reason


@pytest.mark.parametrize(("when", "silence"), [(0.9, 0.2), (1.1, 0.15), (1.0, 0.6)])
def test_a_robot_left_in_mid_swing_recovers(when: float, silence: float) -> None:
    """The controller dies with a foot in the air; the plant holds; another one starts.

    In the second case the robot is tipping towards the raised foot when it is taken over; in the
    third the plant has put the foot down by then.
    """
    down = silence > 0.4
    bench = Bench(WbcConfig(solver="daqp"))
    bench.run(1.2)
    bench.ask(Gait.FORWARD)
    bench.run(when)
    bench.die(silence)
    heights = [bench.plant.data.site(name).xpos[2] for name in ("l_foot", "r_foot")]
    assert (heights[0] - heights[1] < 0.01) if down else (heights[0] - heights[1] > 0.025)
    died = len(bench.states)
    assert bench.states[-1].state is ControlState.LF_SWING
    bench.run(2.4)
    assert not bench.plant.fallen
    states = [state.state for state in bench.states[died:]]
    assert states[0] is (ControlState.STAND if down else ControlState.LF_SWING)
    assert states[-1] is ControlState.BALANCE
    assert bench.states[-1].dcm_error < 0.01
    assert [r.outcome for r in bench.replies] == [GaitOutcome.ACCEPTED, GaitOutcome.ABORTED]
