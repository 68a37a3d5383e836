"""Hand references: following without lag, limits, silence, and no jumps."""

from itertools import cycle, pairwise

import numpy as np
import pytest

from common.robot.rotations import matrix_from_rotation_vector, rotation_vector_from_matrix
from services.wbc.config import HandConfig
from services.wbc.hands import HandReference

from .hand_motion import AHEAD, CONFIG, DT, HOME, PERIOD, Pose, at_x, follow, resting_hand, sine


def test_steady_motion_is_followed_with_little_lag() -> None:
    """0.1 m at 0.5 Hz, 0.31 m/s: a period's lag alone would be 15.7 mm."""
    track = [(t, r) for t, r in follow(resting_hand(), sine, 6.0) if t > 1.0]
    errors = np.array([r.position[0] - sine(t)[0][0] for t, r in track])
    assert np.abs(errors).max() < 0.0065
    assert np.abs(errors).mean() < 0.0023
    wanted = np.array([0.1 * np.pi * np.cos(np.pi * t) for t, _ in track])
    speeds = np.array([r.velocity[0] for _, r in track])
    assert np.abs(speeds - wanted).max() < 0.2
    assert np.abs(speeds - wanted).mean() < 0.03
    # On the whole hardly behind: the error follows the velocity by less than 3 ms of it.
    assert abs(np.mean(errors * wanted) / np.mean(wanted**2)) < 0.003


def test_without_averaging_there_is_no_lag() -> None:
    track = follow(resting_hand(config=HandConfig(tremor_gain=1.0)), sine, 6.0)
    errors = np.array([r.position[0] - sine(t)[0][0] for t, r in track if t > 1.0])
    assert np.abs(errors).max() < 0.0035
    wanted = np.array([np.cos(np.pi * t) * 0.1 * np.pi for t, _ in track if t > 1.0])
    assert abs(np.mean(errors * wanted) / np.mean(wanted**2)) < 0.003


def test_uniform_motion_is_followed_exactly() -> None:
    track = follow(resting_hand(), lambda t: at_x(0.2 + 0.15 * t), 1.5)
    for time, reference in track:
        if time > 0.5:
            assert reference.position[0] == pytest.approx(0.2 + 0.15 * time, abs=1e-9)
            assert reference.velocity[0] == pytest.approx(0.15, abs=1e-6)


def test_turning_is_followed_with_little_lag() -> None:
    axis = np.array([0.6, 0.0, 0.8])

    def pose(time: float) -> Pose:
        return HOME, matrix_from_rotation_vector(0.8 * np.sin(2.0 * time) * axis)

    for time, reference in follow(resting_hand(), pose, 4.0):
        if time > 0.5:
            off = rotation_vector_from_matrix(pose(time)[1] @ reference.rotation.T)
            assert np.linalg.norm(off) < 0.035
            rate = 1.6 * np.cos(2.0 * time) * axis
            assert np.abs(reference.velocity[3:] - rate).max() < 0.6


def test_angular_velocity_is_the_rate_of_the_rotation() -> None:
    up = np.array([0.0, 0.0, 1.0])
    track = follow(resting_hand(), lambda t: (HOME, matrix_from_rotation_vector(t * t * up)), 1.2)
    for (_, a), (_, b) in pairwise(track):
        rate = rotation_vector_from_matrix(b.rotation @ a.rotation.T) / DT
        assert np.abs(rate - 0.5 * (a.velocity + b.velocity)[3:]).max() < 0.007


@pytest.mark.parametrize("turn", [0.3, 1.5, 2.9])
def test_orientation_arrives_by_the_shortest_way(turn: float) -> None:
    goal = matrix_from_rotation_vector(np.array([0.0, turn, 0.0]))
    track = follow(resting_hand(), lambda _: (HOME, goal), 2.0)
    assert np.abs(track[-1][1].rotation - goal).max() < 1e-9
    assert np.abs(track[-1][1].velocity).max() < 1e-9
    for _, reference in track:
        vector = rotation_vector_from_matrix(reference.rotation)
        assert np.abs(vector[[0, 2]]).max() < 1e-9
        assert -1e-9 <= vector[1] < turn + CONFIG.feedforward_rate_max * PERIOD + 1e-9


FAR = [(0.25, 0.0), (0.0, 2.5), (0.2, 2.0)]


def _fastest(move: float, turn: float, repeat: bool) -> tuple[float, float]:
    hand = resting_hand()
    hand.hold(np.array([0.25, 0.2, 0.1]), AHEAD, 0.0)
    goal = np.array([0.25 + move, 0.2, 0.1]), matrix_from_rotation_vector(np.array([0, 0, turn]))
    velocities = np.array(
        [r.velocity for _, r in follow(hand, lambda _: goal, 2.0, np.inf if repeat else 0.01)]
    )
    linear, angular = velocities[:, :3], velocities[:, 3:]
    return float(np.linalg.norm(linear, axis=1).max()), float(np.linalg.norm(angular, axis=1).max())


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize(("move", "turn"), FAR)
def test_a_far_setpoint_is_approached_at_limited_mean_speed(
    move: float, turn: float, repeat: bool
) -> None:
    """A cubic from rest to rest peaks at 1.5 times its mean."""
    speed, rate = _fastest(move, turn, repeat)
    assert speed <= 1.5 * CONFIG.speed_max + 1e-9
    assert rate <= 1.5 * CONFIG.turn_rate_max + 1e-9
    # And not timidly.
    assert speed > 0.35 * CONFIG.speed_max or move == 0.0
    assert rate > 0.35 * CONFIG.turn_rate_max or turn == 0.0


@pytest.mark.parametrize(("move", "turn"), FAR)
def test_a_far_setpoint_is_approached_at_limited_speed(move: float, turn: float) -> None:
    speed, rate = _fastest(move, turn, repeat=True)
    assert speed <= CONFIG.speed_max + 1e-9
    assert rate <= CONFIG.turn_rate_max + 1e-9


def test_references_stay_in_the_workspace() -> None:
    """But for the few millimetres that braking from 0.4 m/s takes."""
    track = follow(resting_hand(), lambda t: at_x(0.3 + 0.4 * t), 2.0)
    assert max(reference.position[0] for _, reference in track) <= 0.56 + 0.005


def test_a_late_setpoint_does_not_halt_the_hand() -> None:
    """Uniform motion, set-points 50, 90, 50 and 80 ms apart."""
    hand, due, late = resting_hand(), 0.0, cycle((0.05, 0.09, 0.05, 0.08))
    for k in range(400):
        time = k * DT
        if time > due - 1e-9:
            hand.set(*at_x(0.2 + 0.15 * time), time)
            due += next(late)
        if time > 0.5:
            assert abs(hand.at(time).position[0] - (0.2 + 0.15 * time)) < 0.001


@pytest.mark.parametrize("side", ["left", "right"])
def test_targets_stay_in_the_workspace(side: str) -> None:
    rng = np.random.default_rng(3)
    sign = 1.0 if side == "left" else -1.0
    hand = resting_hand(side)
    for k in range(200):
        hand.set(rng.uniform(-1.0, 1.0, 3), AHEAD, k * PERIOD)
        x, y, z = hand.target[0]
        assert 0.15 <= x <= 0.56
        assert -0.10 <= sign * y <= 0.45
        assert -0.15 <= z <= 0.40
    hand.set(np.array([0.9, sign * 0.9, -0.9]), AHEAD, 100.0)
    hand.at(101.0)
    assert hand.at(110.0).position == pytest.approx([0.56, sign * 0.45, -0.15], abs=1e-12)


@pytest.mark.parametrize("last", [1.0, 1.31, 1.7])
def test_silence_brings_the_hand_to_rest_at_the_last_setpoint(last: float) -> None:
    hand = resting_hand()
    track = follow(hand, sine, 4.0, until=last)
    final = sine(np.floor((last - 1e-9) / PERIOD) * PERIOD)[0]
    assert hand.target[0] == pytest.approx(final)
    for time, reference in track:
        # Never far off while it stops, and still one stale time later.
        if time > last:
            assert np.abs(reference.position - final).max() < 0.04
        if time > last + 0.5:
            assert reference.position == pytest.approx(final, abs=1e-12)
            assert np.abs(reference.velocity).max() < 1e-12
            assert np.abs(reference.acceleration).max() < 1e-9


def test_setpoints_after_silence_start_from_rest() -> None:
    hand = resting_hand()
    hand.set(*at_x(0.2), 0.0)
    hand.at(0.4)
    hand.at(1.0)
    hand.set(*at_x(0.3), 2.0)
    # 0.1 m in 2 s of silence is no velocity to go on with.
    assert hand.at(2.0).position[0] == pytest.approx(0.2, abs=1e-12)
    peak = max(hand.at(2.0 + k * DT).position[0] for k in range(100))
    assert peak == pytest.approx(0.3, abs=1e-9)


def test_raw_mode_jumps() -> None:
    hand = resting_hand(config=HandConfig(mode="raw"))
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, 1.0]))
    hand.set(np.array([0.4, 0.1, 0.2]), turned, 1.0)
    reference = hand.at(1.0)
    assert reference.position.tolist() == [0.4, 0.1, 0.2]
    assert np.abs(reference.rotation - turned).max() < 1e-15
    assert not reference.velocity.any()
    assert not reference.acceleration.any()
    hand.set(np.array([0.9, 0.1, 0.2]), turned, 1.05)
    assert hand.at(9.0).position.tolist() == [0.56, 0.1, 0.2]


def test_pose_and_velocity_are_continuous_across_setpoints() -> None:
    """Set-points at irregular times and places; the reference as read just before and after."""
    rng = np.random.default_rng(8)
    hand, time = resting_hand(), 0.0
    for _ in range(300):
        time += rng.uniform(0.01, 0.4)
        before = hand.at(time)
        turn = matrix_from_rotation_vector(rng.uniform(-0.5, 0.5, 3))
        hand.set(HOME + rng.uniform(-0.1, 0.1, 3), turn, time)
        after = hand.at(time)
        assert np.abs(after.position - before.position).max() < 1e-12
        assert np.abs(after.rotation - before.rotation).max() < 1e-12
        assert np.abs(after.velocity - before.velocity).max() < 1e-9


def test_reference_moves_as_its_velocity_says() -> None:
    track = follow(resting_hand(), sine, 2.0)
    for (_, a), (_, b) in pairwise(track):
        moved = (b.position - a.position) / DT
        assert np.abs(moved - 0.5 * (a.velocity + b.velocity)[:3]).max() < 0.006


def test_no_pose_yet() -> None:
    hand = HandReference("left", CONFIG)
    assert not hand.started
    with pytest.raises(ValueError, match="no hand set-point yet"):
        hand.at(0.0)
    with pytest.raises(ValueError, match="no hand set-point yet"):
        hand.target  # noqa: B018
    hand.set(HOME, AHEAD, 0.0)
    assert hand.started
    assert np.array_equal(hand.at(5.0).position, HOME)


def test_holding_is_not_clamped() -> None:
    """The robot is taken over where it is, even outside the box."""
    hand = HandReference("left", CONFIG)
    low = np.array([0.0, 0.2, -0.4])
    hand.hold(low, AHEAD, 3.0)
    assert np.array_equal(hand.at(3.0).position, low)
    assert np.array_equal(hand.at(50.0).position, low)
