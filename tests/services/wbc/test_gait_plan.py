"""A gait's timeline: phases, loads, heading and where it goes."""

from itertools import pairwise

import numpy as np
import pytest

from common.schemas import ControlState, Gait
from services.wbc.config import PACES, GaitConfig
from services.wbc.footsteps import Footprint, Side, Stance
from services.wbc.gait_plan import GaitPlan, plan_gait

from .support import GAITS

CONFIG = GaitConfig()
LEFT = (
    ControlState.LF_CONTACT_TRANSITION_START,
    ControlState.LF_CONTACT_TRANSITION_END,
    ControlState.LF_SWING,
)
RIGHT = (
    ControlState.RF_CONTACT_TRANSITION_START,
    ControlState.RF_CONTACT_TRANSITION_END,
    ControlState.RF_SWING,
)
LEFT_FIRST = (Gait.FORWARD, Gait.BACKWARD, Gait.SIDE_LEFT, Gait.TURN_LEFT)
HERE = Stance(np.array([0.4, 0.1]), 0.3)


def _plan(gait: Gait, config: GaitConfig = CONFIG, anchor: Stance = HERE) -> GaitPlan:
    feet = HERE.foot(0, 0.28), HERE.foot(1, 0.28)
    return plan_gait(gait, feet, anchor, HERE.position, HERE.position, config)


@pytest.mark.parametrize("gait", GAITS)
def test_phases_in_the_papers_order(gait: Gait) -> None:
    first, second = (LEFT, RIGHT) if gait in LEFT_FIRST else (RIGHT, LEFT)
    plan = _plan(gait)
    assert [phase.state for phase in plan.phases] == [*first, *second, first[0]]
    feet = [0, 0, 0, 1, 1, 1, 0] if gait in LEFT_FIRST else [1, 1, 1, 0, 0, 0, 1]
    assert [phase.foot for phase in plan.phases] == feet
    assert [phase.step for phase in plan.phases] == [0, 0, 0, 1, 1, 1, 2]


@pytest.mark.parametrize("pace", PACES)
def test_phases_last_as_configured(pace: str) -> None:
    config = GaitConfig(**PACES[pace])
    plan = _plan(Gait.FORWARD, config)
    lengths = [phase.end - phase.start for phase in plan.phases]
    expected = [
        0.6 * config.initial_transfer,
        0.4 * config.initial_transfer,
        config.single_support,
        0.6 * config.double_support,
        0.4 * config.double_support,
        config.single_support,
        config.final_transfer + config.settle,
    ]
    assert lengths == pytest.approx(expected)
    assert plan.phases[0].start == 0.0
    assert plan.duration == pytest.approx(config.duration)
    for before, after in pairwise(plan.phases):
        assert before.end == after.start
        assert plan.phase_at(before.end - 1e-9) is before
        assert plan.phase_at(before.end) is after
    assert plan.phase_at(plan.duration + 10.0) is plan.phases[-1]


@pytest.mark.parametrize("gait", [Gait.FORWARD, Gait.SIDE_RIGHT])
def test_loads_ramp_over_their_share_of_double_support(gait: Gait) -> None:
    plan = _plan(gait)
    sides: tuple[Side, Side] = (0, 1) if gait is Gait.FORWARD else (1, 0)
    first, second = sides
    # Unload over the last 40 % of a double support, load over the first 30 %.
    lift, land = 0.8, 0.8 + 0.65
    assert plan.load_at(first, 0.48) == 1.0
    assert plan.load_at(first, 0.64) == pytest.approx(0.5)
    assert plan.load_at(first, lift - 1e-9) == pytest.approx(0.0, abs=1e-6)
    assert plan.load_at(first, 0.5 * (lift + land)) == 0.0
    assert plan.load_at(first, land) == 0.0
    assert plan.load_at(first, land + 0.5 * 0.3 * 0.35) == pytest.approx(0.5)
    assert plan.load_at(first, land + 0.3 * 0.35) == pytest.approx(1.0)
    lift, land = land + 0.35, land + 0.35 + 0.65
    assert plan.load_at(second, lift - 0.4 * 0.35) == pytest.approx(1.0)
    assert plan.load_at(second, lift - 0.2 * 0.35) == pytest.approx(0.5)
    assert plan.load_at(second, 0.5 * (lift + land)) == 0.0
    assert plan.load_at(second, land + 0.5 * 0.3 * 0.5) == pytest.approx(0.5)
    assert plan.load_at(second, plan.duration + 1.0) == 1.0


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("gait", GAITS)
def test_one_foot_always_carries_all(gait: Gait, pace: str) -> None:
    plan = _plan(gait, GaitConfig(**PACES[pace]))
    times = np.arange(-0.1, plan.duration + 0.1, 0.004)
    loads = np.array([(plan.load_at(0, t), plan.load_at(1, t)) for t in times])
    assert loads.min() == 0.0
    assert (loads.max(axis=1) == 1.0).all()
    # A load never jumps: it takes at least 30 % of 0.2 s.
    assert np.abs(np.diff(loads, axis=0)).max() <= 0.004 / (0.3 * 0.2) + 1e-9


@pytest.mark.parametrize(("gait", "turn"), [(Gait.TURN_LEFT, 0.1 * np.pi), (Gait.FORWARD, 0.0)])
def test_torso_turns_half_in_each_swing(gait: Gait, turn: float) -> None:
    plan = _plan(gait)
    assert plan.yaw_at(0.79) == pytest.approx((0.3, 0.0, 0.0))
    assert plan.yaw_at(1.5)[0] == pytest.approx(0.3 + 0.5 * turn)
    assert plan.yaw_at(1.5)[1:] == pytest.approx((0.0, 0.0))
    assert plan.yaw_at(plan.duration) == pytest.approx((0.3 + turn, 0.0, 0.0))
    h = 1e-5
    for time in (0.9, 1.1, 1.3, 1.9, 2.2):
        before, (_, rate, acceleration), after = (plan.yaw_at(time + d) for d in (-h, 0.0, h))
        assert rate == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-6)
        assert acceleration == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-5)


@pytest.mark.parametrize("gait", GAITS)
def test_vrp_moves_from_the_standing_foot_to_the_first_landing(gait: Gait) -> None:
    plan = _plan(gait)
    standing = HERE.foot(1 if gait in LEFT_FIRST else 0, 0.28).position
    assert np.abs(plan.dcm.at(1.1).vrp - standing).max() < 1e-12
    assert np.abs(plan.dcm.at(2.1).vrp - plan.footprints[0].position).max() < 1e-12
    assert np.abs(plan.dcm.at(plan.duration).dcm - plan.target.position).max() < 1e-12


def test_goes_to_the_anchors_displacement_not_to_the_measured_one() -> None:
    anchor = Stance(HERE.position + np.array([0.03, -0.02]), HERE.yaw + 0.05)
    plan = _plan(Gait.FORWARD, anchor=anchor)
    ahead = np.array([np.cos(anchor.yaw), np.sin(anchor.yaw)])
    assert np.abs(plan.target.position - (anchor.position + 0.2 * ahead)).max() < 1e-12
    assert plan.target.yaw == pytest.approx(anchor.yaw)
    # The heading starts where the robot is and ends where it should have been.
    assert plan.yaw_at(0.0)[0] == pytest.approx(HERE.yaw)
    assert plan.yaw_at(plan.duration)[0] == pytest.approx(anchor.yaw)


def test_heading_across_half_a_turn_takes_the_short_way() -> None:
    here = Stance(np.zeros(2), np.pi - 0.05)
    feet: tuple[Footprint, Footprint] = (here.foot(0, 0.28), here.foot(1, 0.28))
    plan = plan_gait(Gait.TURN_LEFT, feet, here, here.position, here.position, CONFIG)
    assert plan.yaw_at(plan.duration)[0] - plan.yaw_at(0.0)[0] == pytest.approx(0.1 * np.pi)
