"""Every branch of the command guard."""

from typing import Any

import numpy as np
import pytest

from common.plant.config import GuardConfig
from common.plant.guard import Guard, Refusal, refuse_values
from common.plant.stop import StopRecord
from common.robot.joints import POSITION_UPPER
from common.schemas import GuardMode, Header, JointCommand
from tests.services.sim.support import MS, make_command

from .support import EPOCH, NOW, mode, offer, one_joint


def test_silent_until_the_first_command(guard: Guard) -> None:
    assert guard.tick(NOW + 3600_000 * MS, fallen=False) is GuardMode.SILENT
    assert guard.command is None
    assert guard.holds == 0


def test_a_sound_command_is_applied(guard: Guard) -> None:
    command = make_command(NOW - 5 * MS)
    assert offer(guard, command, NOW)
    assert mode(guard) is GuardMode.ACTIVE
    assert guard.command is command
    assert (guard.applied, guard.refused) == (1, 0)


def test_a_loop_delay_of_50_ms_at_100_hz_stays_active(guard: Guard) -> None:
    for tick in range(300):
        now = NOW + (60 + tick) * MS
        if tick % 10 == 0:
            assert offer(guard, make_command(now - 50 * MS), now)
        assert guard.tick(now, fallen=False) is GuardMode.ACTIVE
    assert guard.holds == 0


def test_a_new_guard_takes_a_command_from_the_beginning_of_time() -> None:
    guard = Guard(GuardConfig())
    assert (guard.last_refusal, guard.last_refused) == (None, ("", 0))
    assert offer(guard, make_command(0), 0)


def test_times_are_exact_however_long() -> None:
    guard = Guard(GuardConfig(hold_after=4.0, damp_after=6.0, stop_beat_timeout=3.0))
    guard.beat(0)
    assert offer(guard, make_command(0), 0)
    assert guard.tick(3000 * MS, fallen=False) is GuardMode.ACTIVE
    assert guard.tick(3000 * MS + 1, fallen=False) is GuardMode.HOLD
    guard.beat(3001 * MS)
    assert offer(guard, make_command(0), 3001 * MS)
    assert guard.tick(4000 * MS, fallen=False) is GuardMode.ACTIVE
    assert guard.tick(4000 * MS + 1, fallen=False) is GuardMode.HOLD
    assert guard.holds == 2
    assert guard.tick(6000 * MS, fallen=False) is GuardMode.HOLD
    assert guard.tick(6000 * MS + 1, fallen=False) is GuardMode.DAMP


def test_silence_holds_then_damps(active: Guard) -> None:
    assert active.tick(NOW + 100 * MS, fallen=False) is GuardMode.ACTIVE
    assert active.tick(NOW + 100 * MS + 1, fallen=False) is GuardMode.HOLD
    assert active.tick(NOW + 200 * MS, fallen=False) is GuardMode.HOLD
    assert active.holds == 1
    assert active.tick(NOW + 5000 * MS, fallen=False) is GuardMode.HOLD
    assert active.tick(NOW + 5000 * MS + 1, fallen=False) is GuardMode.DAMP
    assert active.tick(NOW + 9000 * MS, fallen=False) is GuardMode.DAMP
    assert active.holds == 1


@pytest.mark.parametrize("silence_ms", [500, 6000])
def test_a_fresh_command_ends_hold_and_damp(active: Guard, silence_ms: int) -> None:
    now = NOW + silence_ms * MS
    assert active.tick(now, fallen=False) in (GuardMode.HOLD, GuardMode.DAMP)
    assert offer(active, make_command(now - 10 * MS), now)
    assert active.tick(now, fallen=False) is GuardMode.ACTIVE


def test_repeating_an_old_command_does_not_keep_the_robot_active(active: Guard) -> None:
    old = make_command(NOW)
    for ms in range(1, 301):
        offer(active, old, NOW + ms * MS)
        active.tick(NOW + ms * MS, fallen=False)
    assert mode(active) is GuardMode.HOLD
    assert active.last_refusal is Refusal.TOO_OLD
    assert (active.applied, active.refused) == (101, 200)


def test_only_the_clear_of_this_stop_ends_it(active: Guard) -> None:
    active.estop("keyboard", "smoke")
    assert active.tick(NOW, fallen=False) is GuardMode.ESTOP
    assert active.stop == StopRecord(latched=True, stops=1, by="keyboard", reason="smoke")
    assert not offer(active, make_command(NOW), NOW)
    assert active.last_refusal is Refusal.ESTOPPED
    active.estop("headset", "again")
    assert (active.stop.stops, active.stop.by) == (1, "keyboard"), "pressed again: the same stop"
    active.reset(NOW)
    assert mode(active) is GuardMode.ESTOP, "a reset moves the robot, it does not end the stop"
    assert active.tick(NOW + 9000 * MS, fallen=False) is GuardMode.ESTOP
    for wrong in (0, 2):
        assert not active.clear(wrong, NOW)
    assert mode(active) is GuardMode.ESTOP
    assert active.clear(1, NOW)
    assert active.stop == StopRecord(stops=1)
    assert active.tick(NOW + 9000 * MS, fallen=False) is GuardMode.DAMP, "limp, not at work"
    assert not active.clear(1, NOW), "an old clear ends nothing"
    active.estop("keyboard", "smoke again")
    assert not active.clear(1, NOW)
    assert active.stop.stops == 2
    assert mode(active) is GuardMode.ESTOP


def test_after_the_clear_a_command_from_a_later_state_ramps_in(active: Guard) -> None:
    active.estop("keyboard", "")
    assert active.clear(1, NOW + 5 * MS)
    assert not offer(active, make_command(NOW + 5 * MS), NOW + 6 * MS)
    assert active.last_refusal is Refusal.BEFORE_RESET
    assert offer(active, make_command(NOW + 6 * MS), NOW + 6 * MS)
    assert active.tick(NOW + 6 * MS, fallen=False) is GuardMode.ACTIVE
    assert active.applied == 2


def test_a_fall_outlasts_the_stop_and_its_clear(active: Guard) -> None:
    active.estop("keyboard", "")
    assert active.tick(NOW, fallen=True) is GuardMode.ESTOP
    assert active.clear(1, NOW)
    assert active.tick(NOW + MS, fallen=False) is GuardMode.DAMP
    assert not offer(active, make_command(NOW + MS), NOW + MS)
    assert active.last_refusal is Refusal.FALLEN
    active.reset(NOW + MS)
    assert mode(active) is GuardMode.SILENT


def test_comes_up_stopped_if_it_was_stopped() -> None:
    guard = Guard(GuardConfig(), StopRecord(latched=True, stops=3, by="keyboard"))
    assert mode(guard) is GuardMode.ESTOP
    assert not offer(guard, make_command(NOW), NOW)
    assert guard.clear(3, NOW)
    assert mode(guard) is GuardMode.DAMP
    assert mode(Guard(GuardConfig(), StopRecord(stops=3))) is GuardMode.SILENT


def test_a_fallen_robot_stays_damped_until_reset(active: Guard) -> None:
    assert active.tick(NOW, fallen=True) is GuardMode.DAMP
    assert not offer(active, make_command(NOW), NOW)
    assert active.last_refusal is Refusal.FALLEN
    assert active.tick(NOW + MS, fallen=False) is GuardMode.DAMP
    assert not offer(active, make_command(NOW + MS), NOW + MS)
    active.reset(NOW)
    assert active.tick(NOW + MS, fallen=False) is GuardMode.SILENT


def test_falling_before_the_first_command_damps(guard: Guard) -> None:
    assert guard.tick(NOW, fallen=True) is GuardMode.DAMP


@pytest.mark.parametrize(
    ("stamp_ns", "refusal"),
    [
        (EPOCH, Refusal.BEFORE_RESET),
        (EPOCH - 1, Refusal.BEFORE_RESET),
        (NOW + 1, Refusal.FROM_FUTURE),
        (NOW - 5 * MS - 1, Refusal.OUT_OF_ORDER),
    ],
)
def test_stamps_that_are_refused(guard: Guard, stamp_ns: int, refusal: Refusal) -> None:
    first = make_command(NOW - 5 * MS)
    assert offer(guard, first, NOW)
    assert not offer(guard, make_command(stamp_ns), NOW)
    assert guard.last_refusal is refusal
    assert guard.command is first, "the last good command stands"
    assert (guard.applied, guard.refused) == (1, 1)


def test_too_old_even_as_the_first(guard: Guard) -> None:
    late = EPOCH + 200 * MS
    assert offer(guard, make_command(late - 100 * MS), late)
    guard.reset(EPOCH)
    assert not offer(guard, make_command(late - 100 * MS - 1), late)
    assert guard.last_refusal is Refusal.TOO_OLD


def test_the_same_stamp_again_is_no_disorder(active: Guard) -> None:
    assert offer(active, make_command(NOW), NOW + MS)


@pytest.mark.parametrize(
    ("changes", "refusal"),
    [
        ({"position": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"velocity": one_joint("l_elbow_fe", np.inf)}, Refusal.NOT_FINITE),
        ({"acceleration": one_joint("l_elbow_fe", -np.inf)}, Refusal.NOT_FINITE),
        ({"torque": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"stiffness": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"damping": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"gripper_closure": np.array([np.nan, 0.0])}, Refusal.NOT_FINITE),
        ({"stiffness": one_joint("r_ankle_fe", -0.1)}, Refusal.STIFFNESS),
        ({"stiffness": one_joint("r_ankle_fe", 1000.1)}, Refusal.STIFFNESS),
        ({"damping": one_joint("r_ankle_fe", -0.1)}, Refusal.DAMPING),
        ({"damping": one_joint("r_ankle_fe", 12.0)}, Refusal.DAMPING),
        ({"position": one_joint("l_elbow_fe", 0.0872665 + 0.21)}, Refusal.POSITION),
        ({"position": one_joint("l_elbow_fe", -2.0944 - 0.21)}, Refusal.POSITION),
        ({"velocity": one_joint("l_hip_aa", -5 * 5.1 - 0.1)}, Refusal.VELOCITY),
        ({"acceleration": one_joint("neck_pitch", 2001.0)}, Refusal.ACCELERATION),
        ({"torque": one_joint("l_wrist_ps", -24.1)}, Refusal.TORQUE),
        ({"gripper_closure": np.array([0.0, 1.1])}, Refusal.GRIPPER),
        ({"gripper_closure": np.array([-0.1, 0.0])}, Refusal.GRIPPER),
    ],
)
def test_values_that_are_refused(active: Guard, changes: dict[str, Any], refusal: Refusal) -> None:
    standing = active.command
    assert not offer(active, make_command(NOW + MS, **changes), NOW + MS)
    assert active.last_refusal is refusal
    assert active.command is standing
    assert mode(active) is GuardMode.ACTIVE


@pytest.mark.parametrize(
    "changes",
    [
        {"position": one_joint("l_elbow_fe", 0.0872665 + 0.19)},
        {"torque": one_joint("l_hip_fe", 500.0)},
        {"stiffness": np.full(27, 1000.0), "damping": one_joint("l_hip_fe", 60.0)},
        {"velocity": one_joint("l_hip_aa", 25.0)},
        {"gripper_closure": np.array([1.0, 1.04])},
        {"position": POSITION_UPPER},
    ],
)
def test_values_that_are_merely_bold_pass(changes: dict[str, Any]) -> None:
    assert refuse_values(make_command(NOW, **changes)) is None


def by(source: str, boot: int, stamp_ns: int, **changes: Any) -> JointCommand:
    return make_command(
        stamp_ns, header=Header(stamp=stamp_ns, source=source, boot=boot), **changes
    )


def test_obeys_one_controller_until_it_is_silent(guard: Guard) -> None:
    assert guard.controller is None
    assert not offer(guard, by("stray", 1, NOW, torque=np.full(27, 1e6)), NOW)
    assert offer(guard, by("wbc", 7, NOW), NOW), "the first that is valid"
    assert guard.controller == ("wbc", 7)
    for stranger in (by("stray", 1, NOW + MS), by("wbc", 8, NOW + MS)):
        assert not offer(guard, stranger, NOW + MS)
        assert guard.last_refusal is Refusal.OTHER_CONTROLLER
        assert guard.last_refused == stranger.header.sender
    assert (guard.refused, guard.foreign) == (3, 2)
    assert offer(guard, by("wbc", 7, NOW + MS), NOW + MS)
    assert guard.tick(NOW + 102 * MS, fallen=False) is GuardMode.HOLD
    assert guard.controller is None, "nobody is obeyed while the robot is held"
    assert offer(guard, by("wbc", 8, NOW + 102 * MS), NOW + 102 * MS), "restarted"
    assert guard.controller == ("wbc", 8)
    assert not offer(guard, by("wbc", 7, NOW + 103 * MS), NOW + 103 * MS), "back too late"


def test_a_controller_of_another_name_waits_longer(guard: Guard) -> None:
    assert offer(guard, by("wbc", 7, NOW), NOW)
    late = NOW + 1000 * MS
    assert guard.tick(late, fallen=False) is GuardMode.HOLD
    assert not offer(guard, by("stray", 1, late), late)
    assert guard.last_refusal is Refusal.OTHER_CONTROLLER
    assert offer(guard, by("stray", 1, late + 1), late + 1)
    assert guard.controller == ("stray", 1)


@pytest.mark.parametrize("end", ["reset", "clear"])
def test_after_a_reset_or_a_clear_any_controller_is_obeyed(guard: Guard, end: str) -> None:
    assert offer(guard, by("wbc", 7, NOW), NOW)
    if end == "reset":
        guard.reset(NOW)
    else:
        guard.estop("keyboard", "")
        assert guard.clear(1, NOW)
    assert guard.controller is None
    assert offer(guard, by("other", 1, NOW + MS), NOW + MS)
    assert guard.controller == ("other", 1)


@pytest.fixture
def watched() -> Guard:
    """Requires the beat of a stop button within 0.5 s; heard one at NOW and is active."""
    guard = Guard(GuardConfig(stop_beat_timeout=0.5))
    guard.reset(EPOCH)
    assert not offer(guard, make_command(NOW), NOW), "never heard one"
    assert guard.last_refusal is Refusal.NO_BEAT
    assert guard.tick(NOW, fallen=False) is GuardMode.SILENT
    guard.beat(NOW)
    assert offer(guard, make_command(NOW), NOW)
    return guard


def test_without_a_button_the_robot_is_held_and_not_limp(watched: Guard) -> None:
    for ms in range(0, 12_000, 50):
        now = NOW + ms * MS
        assert offer(watched, make_command(now), now) == (ms <= 500)
        watched.tick(now, fallen=False)
        assert mode(watched) is (GuardMode.ACTIVE if ms <= 500 else GuardMode.HOLD)
    assert watched.last_refusal is Refusal.NO_BEAT
    assert watched.holds == 1
    now = NOW + 12_000 * MS
    watched.beat(now)
    assert offer(watched, make_command(now), now)
    assert watched.tick(now + 99 * MS, fallen=False) is GuardMode.ACTIVE


def test_a_missing_button_holds_at_once_and_a_dead_controller_still_goes_limp(
    watched: Guard,
) -> None:
    now = NOW + 450 * MS
    assert offer(watched, make_command(now), now)
    assert watched.tick(NOW + 500 * MS, fallen=False) is GuardMode.ACTIVE
    assert watched.tick(NOW + 500 * MS + 1, fallen=False) is GuardMode.HOLD
    assert watched.tick(now + 5000 * MS, fallen=False) is GuardMode.HOLD
    assert watched.tick(now + 5000 * MS + 1, fallen=False) is GuardMode.DAMP


@pytest.mark.parametrize("history", ["silent", "active", "watched", "held", "limp", "stopped"])
def test_until_it_is_settled_only_a_fall_changes_the_mode(history: str) -> None:
    def begun() -> Guard:
        guard = Guard(GuardConfig(stop_beat_timeout=0.0 if history == "active" else 0.07))
        guard.reset(EPOCH)
        guard.beat(NOW)
        if history == "silent":
            return guard
        assert offer(guard, make_command(NOW), NOW)
        if history == "stopped":
            guard.estop("keyboard", "")
        guard.tick(NOW + {"held": 80, "limp": 9000}.get(history, 0) * MS, fallen=False)
        return guard

    guard = begun()
    mode_now, settled_ns = guard.mode, guard.settled_until_ns()
    ends = {"active": 100, "watched": 70, "held": 5000}
    assert settled_ns == (NOW + ends[history] * MS if history in ends else None)
    last_ns = NOW + 3600_000 * MS if settled_ns is None else settled_ns
    assert guard.tick(last_ns, fallen=False) is mode_now
    if settled_ns is not None:
        assert guard.tick(settled_ns + 1, fallen=False) is not mode_now
    fallen = begun()
    fallen.tick(NOW + 1, fallen=True)
    assert fallen.settled_until_ns() is None
