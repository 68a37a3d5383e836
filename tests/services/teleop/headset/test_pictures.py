"""Pictures on their way to the pages, and what of them comes back as the time that was seen."""

from typing import Any

import pytest

from common.schemas import CameraFrame, Header
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, TELEOP_DEVICE

from .people import Room

NOW = 123
"""Robot time that the invented controller states [ns]."""


def show(room: Room, left: int, right: int, encoding: Any = "jpeg") -> None:
    eye: Any
    for topic, eye, stamp in ((CAMERA_LEFT, "left", left), (CAMERA_RIGHT, "right", right)):
        header, data = Header(stamp=stamp), f"{eye} {stamp}".encode()
        frame = {"header": header, "width": 4, "height": 3, "encoding": encoding, "data": data}
        room.bench.inputs.put(topic, CameraFrame(eye=eye, **frame))
    room.run(0.1)


def test_a_pair_reaches_the_pages_once() -> None:
    room = Room()
    show(room, 100, 100)
    picture = room.operator.hub.picture
    assert picture is not None
    assert (picture.left, picture.right, picture.number) == (b"left 100", b"right 100", 1)
    show(room, 100, 100)
    assert room.operator.hub.picture is picture
    show(room, 110, 110)
    assert room.operator.hub.picture is not picture


@pytest.mark.parametrize(
    ("stamps", "encoding", "why"),
    [((100, 100), "rgb8", "expected [cameras] encoding"), (None, "jpeg", "silent")],
)
def test_the_pages_are_told_why_there_are_none(
    stamps: tuple[int, int] | None, encoding: str, why: str
) -> None:
    room = Room()
    if stamps:
        show(room, *stamps, encoding)
    else:
        room.bench.inputs.stale |= {CAMERA_LEFT.name, CAMERA_RIGHT.name}
    room.run(0.1)
    assert room.operator.hub.picture is None
    assert why in room.operator.hub.status["cameras"]


def test_pictures_of_different_times_are_no_pair() -> None:
    room = Room()
    show(room, 100, 90)
    assert room.operator.hub.picture is None


def test_a_sample_bears_the_time_of_the_picture_that_was_shown() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    assert room.bench.messages(TELEOP_DEVICE)[-1].header.stamp == NOW
    show(room, 100, 100)
    person.send("shown", picture=1)
    person.wear(0.1)
    assert room.bench.messages(TELEOP_DEVICE)[-1].header.stamp == 100
    assert room.setpoints[-1].header.stamp == 100
    # One that was never sent is none.
    person.send("shown", picture=7)
    person.wear(0.1)
    assert room.setpoints[-1].header.stamp == 100


def test_a_picture_of_an_earlier_robot_is_not_what_is_seen() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    show(room, NOW + 50, NOW + 50)
    person.send("shown", picture=1)
    person.wear(0.1)
    assert room.setpoints[-1].header.stamp == NOW
