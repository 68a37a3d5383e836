"""Frames lie on a grid, hold the last set-point, and have the gait of their sample."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import pytest

from common.operator.holds import HoldBook
from common.schemas import (
    AuthorityChange,
    ControllerState,
    Gait,
    GaitRequest,
    Header,
    Message,
    OperatorKind,
    PlantState,
    Setpoint,
)
from lab.demonstrations.frames import EpisodeFrames, Moment, Picture
from tests.common.operator.support import said
from tests.common.transport.support import examples

MESSAGES = {type(message): message for message in examples()}
SAMPLES = (100, 150, 200)
"""Times at which the operator sampled its device [ms]."""
MS = 1_000_000
M = TypeVar("M", bound=Message)
Given = Setpoint | GaitRequest


def made(kind: type[M], **changes: object) -> M:
    """A message like the example of its kind, with changes."""
    example = MESSAGES[kind]
    assert isinstance(example, kind)
    return example.model_copy(update=changes)


def moment(at: float) -> Moment[str]:
    """What is newest at a time [ms]: a state that is 3 ms old, and a picture named by the time."""
    state = made(PlantState, header=Header(stamp=round((at - 3) * MS)))
    picture = Picture(round((at - 20) * MS), f"at {at:g}")
    return Moment(round(at * MS), state, made(ControllerState), picture, None)


def header(sampled: int, seen: int, source: str = "teleop") -> Header:
    """Of a message of the sample at a time, when the newest thing seen was of another [ms]."""
    boot = len(source)
    return Header(stamp=seen * MS, captured=sampled * MS, source=source, boot=boot)


def setpoint(sampled: int, seen: int, source: str = "teleop", neck: float = 0.0) -> Setpoint:
    return made(Setpoint, header=header(sampled, seen, source), neck_pitch=neck)


def turn(sampled: int, seen: int) -> GaitRequest:
    return GaitRequest(header=header(sampled, seen), request_id=1, gait=Gait.TURN_LEFT)


def gaits(messages: Sequence[Given]) -> list[int]:
    """Take messages in in this order and return the gait of each frame."""
    frames: EpisodeFrames[str] = EpisodeFrames()
    for message in messages:
        if isinstance(message, GaitRequest):
            frames.gait(message)
        else:
            frames.setpoint(message, moment(message.header.captured / MS))
    return [int(gait) for gait in np.array(frames.rows.rows["action/locomotion"])]


@pytest.mark.parametrize("place", range(len(SAMPLES) + 1))
def test_a_gait_belongs_to_its_sample_wherever_it_comes_in_the_order(place: int) -> None:
    """Among three samples it is the second's: before, after, and later than the third."""
    messages: list[Given] = [setpoint(sample, sample) for sample in SAMPLES]
    messages.insert(place, turn(SAMPLES[1], SAMPLES[1]))
    assert gaits(messages) == [0, int(Gait.TURN_LEFT), 0]


@pytest.mark.parametrize("order", [list, lambda sent: sent[::-1]], ids=["after", "before"])
def test_while_nothing_new_is_seen_the_samples_stay_apart(
    order: Callable[[list[Given]], list[Given]],
) -> None:
    messages: list[Given] = [setpoint(SAMPLES[0], 70)]
    both: list[Given] = [setpoint(SAMPLES[1], 70), turn(SAMPLES[1], 70)]
    messages += order(both)
    messages += [setpoint(SAMPLES[2], 70)]
    assert gaits(messages) == [0, int(Gait.TURN_LEFT), 0]


def test_a_gait_without_its_set_point_is_in_no_other_frame() -> None:
    messages: list[Given] = [setpoint(SAMPLES[0], SAMPLES[0]), turn(SAMPLES[1], SAMPLES[1])]
    assert gaits([*messages, setpoint(SAMPLES[2], SAMPLES[2])]) == [0, 0]


def test_frames_say_how_old_their_parts_are_and_which_picture_they_show() -> None:
    frames: EpisodeFrames[str] = EpisodeFrames()
    for at in SAMPLES:
        frames.setpoint(setpoint(at, at - 10), moment(at))
    rows = frames.rows.rows
    assert frames.pictures == ["at 100", "at 150", "at 200"]
    assert rows["time/seen_ns"] == [90 * MS, 140 * MS, 190 * MS]
    assert rows["age/picture"] == pytest.approx([0.02] * 3)
    assert rows["age/state"] == pytest.approx([0.003] * 3)
    assert not rows["age/truth"]


def test_each_place_of_the_grid_has_one_frame_however_the_set_points_jitter() -> None:
    frames: EpisodeFrames[str] = EpisodeFrames()
    for at, neck in ((100, 0.1), (148, 0.2), (156, 0.3), (210, 0.4), (240, 0.5)):
        frames.setpoint(setpoint(at, at, neck=neck), moment(at))
    rows = frames.rows.rows
    assert rows["time/robot_ns"] == [100 * MS, 148 * MS, 210 * MS, 240 * MS]
    assert rows["action/neck"] == [0.1, 0.2, 0.4, 0.5]
    assert frames.worst_ns == 10 * MS


def heard(
    frames: EpisodeFrames[str], until: int, given: dict[int, Setpoint]
) -> dict[str, list[Any]]:
    """Let time pass in steps of 5 ms; set-points come at the times given [ms]."""
    for at in range(100, until, 5):
        if frames.is_due(at * MS):
            frames.tick(moment(at))
        if at in given:
            frames.setpoint(given[at], moment(at))
    return frames.rows.rows


def test_where_no_set_point_comes_a_frame_holds_the_last_one() -> None:
    frames: EpisodeFrames[str] = EpisodeFrames()
    given = {at: setpoint(at, at, neck=0.001 * at) for at in (100, 150, 310, 350)}
    rows = heard(frames, 400, given)
    assert rows["time/robot_ns"] == [at * MS for at in (100, 150, 200, 250, 310, 350)]
    assert rows["action/neck"] == pytest.approx([0.1, 0.15, 0.15, 0.15, 0.31, 0.35])
    assert frames.pictures[3] == "at 250"


def test_of_two_operators_whoever_has_the_robot_acts_and_an_intervention_is_marked() -> None:
    holds = HoldBook()
    frames: EpisodeFrames[str] = EpisodeFrames(holds)
    holds.observe(said(1, AuthorityChange.GRANTED, "policy"), 0)
    given = {at: setpoint(at, at, "policy", 0.1) for at in (100, 150)}
    heard(frames, 200, given)
    holds.observe(said(2, AuthorityChange.TAKEN, "teleop", OperatorKind.PERSON), 200)
    frames.setpoint(setpoint(205, 205, "policy", 0.2), moment(205))
    for at in (220, 270):
        frames.setpoint(setpoint(at, at, "teleop", 0.3), moment(at))
    rows = frames.rows.rows
    assert rows["action/neck"] == [0.1, 0.1, 0.3, 0.3]
    assert rows["intervention"] == [False, False, True, True]
    assert frames.operator == "mixed"
