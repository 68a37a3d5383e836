"""The state machine, driven by a robot that does exactly what it is told."""

from itertools import groupby, pairwise

import numpy as np
import pytest

from common.schemas import ControlState, Gait, GaitOutcome
from services.wbc.config import WbcConfig, wbc_config
from services.wbc.references import UNLOADED
from services.wbc.robot_model import RobotModel

from .ideal import IdealRobot
from .support import GAITS

CONFIG = WbcConfig()
FAST = wbc_config(pace="fast")
DT = 0.01


@pytest.fixture
def standing(model: RobotModel) -> IdealRobot:
    """In BALANCE, at the origin, ready to walk fast."""
    robot = IdealRobot(model, FAST)
    robot.run(1.1)
    assert robot.locomotion.state is ControlState.BALANCE
    return robot


def test_stands_up_to_the_middle_of_the_feet(model: RobotModel) -> None:
    robot = IdealRobot(model, CONFIG)
    start = robot.com
    first = robot.tick()
    assert np.abs(first.com - start).max() < 1e-12
    robot.run(1.02)
    states = [state for _, state, _ in robot.trace]
    # 1 s, give or take the tick that rounding decides.
    assert states[:100] == [ControlState.STAND] * 100
    assert states[101:] == [ControlState.BALANCE] * 2
    last = robot.tick()
    assert np.abs(last.com - (0.0, 0.0, 0.70)).max() < 1e-9
    assert not last.com_velocity.any()
    for (_, _, a), (_, _, b) in pairwise(robot.trace):
        assert np.abs(b.com - a.com - 0.5 * DT * (a.com_velocity + b.com_velocity)).max() < 1e-5


@pytest.mark.parametrize("gait", GAITS)
def test_states_in_the_papers_order_and_durations(model: RobotModel, gait: Gait) -> None:
    robot = IdealRobot(model, CONFIG)
    robot.run(1.1)
    robot.trace.clear()
    robot.walk(gait)
    left = [5, 6, 7]
    right = [2, 3, 4]
    first, second = (right, left) if gait in (Gait.SIDE_RIGHT, Gait.TURN_RIGHT) else (left, right)
    runs = [(state, len(list(run))) for state, run in groupby(s for _, s, _ in robot.trace)]
    assert [int(state) for state, _ in runs] == [*first, *second, first[0], 1]
    lengths = [0.48, 0.32, 0.65, 0.21, 0.14, 0.65, 0.9]
    assert [DT * count for _, count in runs[:-1]] == pytest.approx(lengths, abs=1.01 * DT)
    walking = sum(count for _, count in runs[:-1])
    assert walking * DT == pytest.approx(3.35, abs=DT)


@pytest.mark.parametrize(
    ("pace", "seconds"), [("fast", 2.2), ("normal", 3.35), ("slow", 3.95), ("public", 6.1)]
)
def test_a_gait_takes_as_long_as_its_pace_says(
    model: RobotModel, pace: str, seconds: float
) -> None:
    robot = IdealRobot(model, wbc_config(pace=pace))
    robot.run(1.1)
    robot.locomotion.request(3, Gait.FORWARD)
    robot.tick()
    accepted = robot.time
    while len(robot.answers) < 2 and robot.time < accepted + 2.0 * seconds:
        robot.tick()
    assert [a.outcome for a in robot.answers] == [GaitOutcome.ACCEPTED, GaitOutcome.COMPLETED]
    assert [a.request_id for a in robot.answers] == [3, 3]
    assert robot.time - accepted == pytest.approx(seconds, abs=DT + 1e-6)


@pytest.mark.parametrize("gait", GAITS)
def test_feet_end_in_the_displaced_stance(standing: IdealRobot, gait: Gait) -> None:
    standing.walk(gait)
    expected = {
        Gait.FORWARD: (0.2, 0.0, 0.0),
        Gait.BACKWARD: (-0.2, 0.0, 0.0),
        Gait.SIDE_LEFT: (0.0, 0.1, 0.0),
        Gait.SIDE_RIGHT: (0.0, -0.1, 0.0),
        Gait.TURN_LEFT: (0.0, 0.0, 0.314159),
        Gait.TURN_RIGHT: (0.0, 0.0, -0.314159),
    }[gait]
    middle, yaw = standing.stance()
    # The last tick of a swing comes up to 10 ms before its end.
    assert (*middle, yaw) == pytest.approx(expected, abs=1e-4)
    last = standing.trace[-1][2]
    assert np.abs(last.com[:2] - middle).max() < 0.005
    assert last.torso.rotation[1, 0] == pytest.approx(np.sin(yaw), abs=1e-4)


def test_refuses_until_it_balances(model: RobotModel) -> None:
    robot = IdealRobot(model, CONFIG)
    robot.locomotion.request(1, Gait.FORWARD)
    robot.tick()
    (answer,) = robot.answers
    assert (answer.request_id, answer.gait) == (1, Gait.FORWARD)
    assert answer.outcome is GaitOutcome.REFUSED
    assert answer.reason == "state is STAND; gaits start from BALANCE"
    assert robot.locomotion.gait is Gait.NONE


def test_refuses_none_and_a_second_gait(standing: IdealRobot) -> None:
    locomotion = standing.locomotion
    locomotion.request(1, Gait.NONE)
    standing.tick()
    assert standing.answers[-1].outcome is GaitOutcome.REFUSED
    assert "NONE is not a gait" in standing.answers[-1].reason
    # Two at once: the first is taken, the second has come too early.
    locomotion.request(2, Gait.SIDE_LEFT)
    locomotion.request(3, Gait.FORWARD)
    standing.tick()
    two, three = standing.answers[-2:]
    assert (two.request_id, two.outcome) == (2, GaitOutcome.ACCEPTED)
    assert (three.request_id, three.outcome) == (3, GaitOutcome.REFUSED)
    assert three.reason.startswith("SIDE_LEFT is still in progress")
    standing.run(1.5)
    locomotion.request(4, Gait.FORWARD)
    standing.tick()
    assert locomotion.gait is Gait.SIDE_LEFT
    standing.run(1.0)
    last = [(a.request_id, a.outcome) for a in standing.answers[-2:]]
    assert last == [(4, GaitOutcome.REFUSED), (2, GaitOutcome.COMPLETED)]
    assert locomotion.answers() == []


def test_the_next_gait_may_start_with_the_completion_of_the_last(standing: IdealRobot) -> None:
    locomotion = standing.locomotion
    locomotion.request(1, Gait.FORWARD)
    standing.tick()
    start = standing.time
    while locomotion.completed == 0 and standing.time < start + 5.0:
        # Asked every tick: refused until the very tick in which the first is complete.
        locomotion.request(2, Gait.FORWARD)
        standing.tick()
    outcomes = [(a.request_id, a.outcome) for a in standing.answers]
    assert outcomes[-2:] == [(1, GaitOutcome.COMPLETED), (2, GaitOutcome.ACCEPTED)]
    assert outcomes[1:-2] == [(2, GaitOutcome.REFUSED)] * (len(outcomes) - 3)
    assert len(outcomes) > 200


def test_progress_grows_from_zero_to_one(standing: IdealRobot) -> None:
    locomotion = standing.locomotion
    assert locomotion.progress(standing.time) == 0.0
    locomotion.request(1, Gait.TURN_LEFT)
    shares: list[float] = []
    standing.tick()
    while locomotion.gait is not Gait.NONE and len(shares) < 300:
        shares.append(locomotion.progress(standing.time))
        standing.tick()
    assert shares[0] == 0.0
    assert np.diff(shares) == pytest.approx(DT / 2.2, abs=1e-9)
    assert shares[-1] > 0.99
    assert locomotion.progress(standing.time) == 0.0


@pytest.mark.parametrize("gait", [Gait.FORWARD, Gait.SIDE_RIGHT])
def test_normal_force_limits_follow_the_schedule(standing: IdealRobot, gait: Gait) -> None:
    standing.trace.clear()
    standing.walk(gait)
    limits = np.array([reference.normal_force_max for _, _, reference in standing.trace])
    assert limits.max() == 1000.0
    assert limits.min() == UNLOADED
    assert (limits.max(axis=1) == 1000.0).all()
    for limit, (_, state, reference) in zip(limits, standing.trace, strict=True):
        for side in (0, 1):
            swinging = state is (ControlState.LF_SWING, ControlState.RF_SWING)[side]
            assert (reference.swing[side] is not None) == swinging
            assert limit[side] == UNLOADED or not swinging
    # In swing, fast pace: 0.5 s per foot, and one tick more as the ramps touch zero.
    assert (limits == UNLOADED).sum(axis=0) == pytest.approx([50, 50], abs=2)


@pytest.mark.parametrize("gait", GAITS)
def test_references_never_jump(standing: IdealRobot, gait: Gait) -> None:
    standing.walk(gait)
    standing.walk(gait)
    for (_, _, a), (_, _, b) in pairwise(standing.trace):
        mean_velocity = 0.5 * (a.com_velocity + b.com_velocity)
        assert np.abs(b.com - a.com - DT * mean_velocity).max() < 5e-4
        assert np.abs(b.com_velocity - a.com_velocity).max() < 0.05
        assert np.abs(b.com_acceleration - a.com_acceleration).max() < 0.6
        assert np.abs(b.torso.rotation - a.torso.rotation).max() < 0.012
        for before, after in zip(a.swing, b.swing, strict=True):
            if before is not None and after is not None:
                assert np.abs(after.position - before.position).max() < 0.012


def test_swings_start_where_the_foot_is_and_clear_the_ground(standing: IdealRobot) -> None:
    (left, _), (right, _) = standing.feet
    standing.trace.clear()
    standing.walk(Gait.FORWARD)
    for side, start in ((0, left), (1, right)):
        swings = (reference.swing[side] for _, _, reference in standing.trace)
        path = np.array([swing.position for swing in swings if swing is not None])
        assert np.abs(path[0] - start).max() < 1e-3
        assert path[:, 2].max() == pytest.approx(0.05, abs=1e-4)
        assert path[:, 2].min() > -1e-9


@pytest.mark.parametrize("offset", [(0.02, 0.0), (0.0, -0.025), (-0.015, 0.015)])
def test_small_drift_is_corrected_by_the_next_gait(
    standing: IdealRobot, offset: tuple[float, float]
) -> None:
    standing.walk(Gait.FORWARD)
    standing.slip(np.array(offset), turn=0.03)
    standing.walk(Gait.FORWARD)
    middle, yaw = standing.stance()
    assert (*middle, yaw) == pytest.approx((0.4, 0.0, 0.0), abs=3e-4)


@pytest.mark.parametrize(
    ("offset", "turn"), [((0.06, 0.0), 0.0), ((0.0, -0.05), 0.0), ((0.0, 0.0), 0.12)]
)
def test_large_drift_starts_afresh(
    standing: IdealRobot, offset: tuple[float, float], turn: float
) -> None:
    standing.walk(Gait.FORWARD)
    standing.slip(np.array(offset), turn)
    before, heading = standing.stance()
    standing.walk(Gait.FORWARD)
    middle, yaw = standing.stance()
    ahead = 0.2 * np.array([np.cos(heading), np.sin(heading)])
    assert np.abs(middle - (before + ahead)).max() < 3e-4
    assert yaw == pytest.approx(heading, abs=1e-4)
    assert abs(yaw - turn) < 1e-3


def test_landing_errors_do_not_add_up(standing: IdealRobot) -> None:
    """Ten gaits, each followed by the same 20 mm slip: one slip's worth of error remains."""
    for _ in range(10):
        standing.walk(Gait.SIDE_LEFT)
        standing.slip(np.array([0.02, 0.0]))
    middle, _ = standing.stance()
    assert middle == pytest.approx([0.02, 1.0], abs=1e-3)


def test_footprints_are_averaged_over_a_noisy_measurement(model: RobotModel) -> None:
    """Noise of 5 mm and 0.3 degrees: a single look at the feet would err by as much."""
    robot = IdealRobot(model, FAST)
    robot.noise = 0.005
    robot.run(1.5)
    robot.walk(Gait.BACKWARD)
    middle, yaw = robot.stance()
    assert np.abs(middle - (-0.2, 0.0)).max() < 0.002
    assert abs(yaw) < 0.003
    swings = [r.swing[0] for _, _, r in robot.trace if r.swing[0] is not None]
    assert np.abs(swings[0].position - (0.0, 0.14, 0.0)).max() < 0.003


def test_com_height_is_above_the_soles_wherever_the_ground_is(model: RobotModel) -> None:
    robot = IdealRobot(model, FAST, ground=0.3)
    robot.run(1.1)
    robot.walk(Gait.FORWARD)
    assert robot.trace[-1][2].com[2] == pytest.approx(1.0, abs=1e-3)
    assert robot.feet[0][0][2] == pytest.approx(0.3, abs=1e-6)


def test_com_height_is_steady_on_raised_ground(model: RobotModel) -> None:
    robot = IdealRobot(model, FAST, ground=0.3)
    robot.run(1.1)
    robot.walk(Gait.FORWARD)
    heights = [r.com[2] for t, _, r in robot.trace if t > 6.1]
    assert max(heights) - min(heights) < 1e-3
