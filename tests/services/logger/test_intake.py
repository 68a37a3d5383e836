"""The queue keeps the samples that fit and counts the others."""

from common.schemas import Gait, GaitRequest, Header
from common.transport.tap import RawSample
from common.wire.codec import encode
from services.logger.record.intake import Intake


def sample(key: str, size: int, at: int = 0) -> RawSample:
    return RawSample(key, bytes(size), "", at)


def test_everything_offered_is_taken_or_counted_as_dropped() -> None:
    intake = Intake(max_messages=3, max_bytes=1000)
    accepted = [intake.offer(sample("a", 10, at)) for at in range(5)]
    assert accepted == [True, True, True, False, False]
    assert [one.arrival_ns for one in intake.take()] == [0, 1, 2]
    assert intake.dropped == 2
    assert intake.take_drops().report()["a"].dropped == 2
    assert intake.take() == []


def test_bytes_are_bounded_and_given_back() -> None:
    intake = Intake(max_messages=100, max_bytes=100)
    assert intake.offer(sample("big", 90))
    assert not intake.offer(sample("big", 20))
    assert intake.offer(sample("small", 10))
    intake.take()
    assert intake.offer(sample("big", 90))
    assert intake.take_drops().report()["big"].dropped == 1


def test_the_numbers_of_what_is_dropped_are_kept_once() -> None:
    intake = Intake(max_messages=2, max_bytes=10_000)
    for seq in range(6):
        payload = encode(
            GaitRequest(request_id=seq, gait=Gait.FORWARD), Header(seq=seq, boot=7, source="t")
        )
        intake.offer(RawSample("draco3/teleop/gait", payload, "", seq))
    drops = intake.take_drops()
    count = drops.report()["draco3/teleop/gait"]
    assert (count.sent, count.dropped, count.earlier, count.headerless) == (4, 4, 2, 0)
    assert drops.streams() == {"draco3/teleop/gait": [("t", 7)]}
    assert not intake.take_drops()
