"""Identification of repeated gait requests, so that a repeated request is not a second gait.

A sender that missed the reply sends the same request again. Boot id and request id identify it;
it is answered with the latest known answer.
"""

from collections import OrderedDict

from common.schemas import GaitOutcome, GaitRequest
from services.wbc.locomotion import Answer

REMEMBERED = 256
"""Number of requests whose last answer is kept."""


class RequestTracker:
    """Numbers requests for the state machine and keeps the latest answer to each."""

    def __init__(self) -> None:
        self._numbers: OrderedDict[tuple[int, int], int] = OrderedDict()
        self._ids: dict[int, int] = {}
        self._answers: dict[int, Answer] = {}
        self._count = 0

    def register(self, request: GaitRequest) -> int | None:
        """Return the number of a new request; None if it is known already."""
        key = (request.header.boot, request.request_id)
        if key in self._numbers:
            return None
        self._count += 1
        self._numbers[key] = self._count
        self._ids[self._count] = request.request_id
        if len(self._numbers) > REMEMBERED:
            self._forget_one()
        return self._count

    def _forget_one(self) -> None:
        """Discard the oldest request that has its final answer."""
        for key, number in self._numbers.items():
            answer = self._answers.get(number)
            if answer is not None and answer.outcome is not GaitOutcome.ACCEPTED:
                del self._numbers[key], self._ids[number], self._answers[number]
                return

    def answer_to(self, request: GaitRequest) -> Answer | None:
        """Return the latest answer to a known request, with the sender's request id."""
        number = self._numbers.get((request.header.boot, request.request_id))
        answer = None if number is None else self._answers.get(number)
        if answer is None:
            return None
        return Answer(request.request_id, answer.gait, answer.outcome, answer.reason)

    def record(self, answer: Answer) -> None:
        """Keep an answer of the state machine."""
        self._answers[answer.request_id] = answer

    def request_id(self, answer: Answer) -> int:
        """Return the sender's request id of an answer of the state machine."""
        return self._ids.get(answer.request_id, answer.request_id)
