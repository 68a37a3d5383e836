"""What a policy needs beside the newest value: those before it, and stereo pairs."""

from typing import Any

import pytest

from common.errors import TrillError
from common.inbox.inbox import Inbox
from common.schemas import CameraFrame, Header
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_STATE, Topic
from common.wire.codec import encode
from tests.common.transport.support import example_of, plant_state

MS = 1_000_000


def put(inbox: Inbox, topic: Topic[Any], seq: int, at_ns: int, stamp: int = 0) -> None:
    message = plant_state() if topic is PLANT_STATE else example_of(CameraFrame)
    header = Header(seq=seq, boot=1, source="sim", sent=at_ns, stamp=stamp)
    inbox.offer(topic.name, encode(message, header), at_ns)


def test_history_reaches_back_from_the_newest() -> None:
    inbox = Inbox((PLANT_STATE,))
    for number in range(1, 101):
        at = number * 5 * MS
        put(inbox, PLANT_STATE, number, at)
        inbox.begin_step(at)
        states = inbox.history(PLANT_STATE, 0.1)
        assert [state.header.seq for state in states] == list(
            range(max(1, number - 20), number + 1)
        )
    # A shorter one is a part of it, and silence takes nothing away.
    inbox.begin_step(9000 * MS)
    assert [state.header.seq for state in inbox.history(PLANT_STATE, 0.01)] == [98, 99, 100]


def test_history_is_kept_from_the_first_call_on() -> None:
    inbox = Inbox((PLANT_STATE,))
    assert inbox.history(PLANT_STATE, 1.0) == []
    with pytest.raises(TrillError, match="not among"):
        inbox.history(CAMERA_LEFT, 1.0)
    other = Inbox((PLANT_STATE,))
    for number in (1, 2):
        put(other, PLANT_STATE, number, number * MS)
    other.begin_step(2 * MS)
    assert [state.header.seq for state in other.history(PLANT_STATE, 1.0)] == [2]


def stamps(pair: tuple[CameraFrame, CameraFrame] | None) -> tuple[int, int] | None:
    return None if pair is None else (pair[0].header.stamp, pair[1].header.stamp)


def test_a_pair_is_of_one_stamp_whatever_came_last() -> None:
    inbox = Inbox((CAMERA_LEFT, CAMERA_RIGHT))
    inbox.begin_step(0)
    assert inbox.latest_pair(CAMERA_LEFT, CAMERA_RIGHT) is None
    # The left picture of 100 is lost, and the right one of 150 still under way.
    for number, (topic, stamp) in enumerate(
        ((CAMERA_LEFT, 50), (CAMERA_RIGHT, 50), (CAMERA_RIGHT, 100), (CAMERA_LEFT, 150))
    ):
        at = (number + 1) * 10 * MS
        put(inbox, topic, number, at, stamp)
        inbox.begin_step(at)
        expected = (50, 50) if number else None
        assert stamps(inbox.latest_pair(CAMERA_LEFT, CAMERA_RIGHT)) == expected
    put(inbox, CAMERA_RIGHT, 9, 60 * MS, 150)
    inbox.begin_step(60 * MS)
    assert stamps(inbox.latest_pair(CAMERA_LEFT, CAMERA_RIGHT)) == (150, 150)
