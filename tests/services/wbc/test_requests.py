"""Requests named by their sender, so that a repetition is not a second gait."""

from common.schemas import Gait, GaitOutcome, GaitRequest, Header
from services.wbc.locomotion import Answer
from services.wbc.requests import REMEMBERED, RequestTracker


def _request(request_id: int, boot: int = 1) -> GaitRequest:
    return GaitRequest(header=Header(boot=boot), request_id=request_id, gait=Gait.FORWARD)


def test_a_repeated_request_gets_the_latest_answer() -> None:
    book = RequestTracker()
    number = book.register(_request(40))
    assert number is not None
    assert book.answer_to(_request(40)) is None
    assert book.register(_request(40)) is None
    book.record(Answer(number, Gait.FORWARD, GaitOutcome.ACCEPTED))
    book.record(Answer(number, Gait.FORWARD, GaitOutcome.COMPLETED, "done"))
    known = book.answer_to(_request(40))
    assert known == Answer(number, Gait.FORWARD, GaitOutcome.COMPLETED, "done")


def test_senders_do_not_share_request_ids() -> None:
    book = RequestTracker()
    one, other = book.register(_request(1, boot=1)), book.register(_request(1, boot=2))
    assert one is not None
    assert other is not None
    assert one != other
    assert book.record(Answer(one, Gait.FORWARD, GaitOutcome.REFUSED)).header.boot == 1
    assert book.answer_to(_request(1, boot=2)) is None
    assert book.record(Answer(other, Gait.FORWARD, GaitOutcome.ACCEPTED)).header.boot == 2


def test_old_requests_are_forgotten() -> None:
    book = RequestTracker()
    for k in range(REMEMBERED + 10):
        number = book.register(_request(k))
        assert number is not None
        book.record(Answer(number, Gait.FORWARD, GaitOutcome.REFUSED))
    assert book.answer_to(_request(9)) is None
    assert book.answer_to(_request(10)) is not None
    # A forgotten one is new again.
    assert book.register(_request(9)) is not None


def test_a_request_in_progress_is_not_forgotten() -> None:
    book = RequestTracker()
    running = book.register(_request(7))
    assert running is not None
    book.record(Answer(running, Gait.FORWARD, GaitOutcome.ACCEPTED))
    for k in range(100, 100 + REMEMBERED + 20):
        number = book.register(_request(k))
        assert number is not None
        book.record(Answer(number, Gait.FORWARD, GaitOutcome.REFUSED))
    assert book.register(_request(7)) is None
    assert book.record(Answer(running, Gait.FORWARD, GaitOutcome.COMPLETED)).request_id == 7


def test_no_request_is_forgotten_before_its_answer() -> None:
    """A thousand at one instant: every one keeps its sender and gets its answer."""
    book = RequestTracker()
    numbers = [book.register(_request(k, boot=k)) for k in range(1000)]
    for k, number in enumerate(numbers):
        assert number is not None
        answered = book.record(Answer(number, Gait.FORWARD, GaitOutcome.REFUSED))
        assert (answered.request_id, answered.header.boot) == (k, k)
