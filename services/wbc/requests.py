"""Identification of repeated gait requests, so that a repeated request is not a second gait.

A sender that missed the reply sends the same request again. Boot id and request id identify it;
it is answered with the latest known answer.
"""

from collections import deque

from common.schemas import GaitOutcome, GaitRequest
from services.wbc.locomotion import Answer

REMEMBERED = 256
"""Number of finished requests whose answer is kept."""


class RequestTracker:
    """Numbers requests for the state machine and keeps the latest answer to each."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[int, int], int] = {}
        self._requests: dict[int, GaitRequest] = {}
        self._answers: dict[int, Answer] = {}
        self._finished: deque[int] = deque()
        self._count = 0

    def register(self, request: GaitRequest) -> int | None:
        """Return the number of a new request; None if it is known already."""
        key = _key(request)
        if key in self._numbers:
            return None
        self._count += 1
        self._numbers[key] = self._count
        self._requests[self._count] = request
        return self._count

    def answer_to(self, request: GaitRequest) -> Answer | None:
        """Return the latest answer to a request; None if it is new or not yet answered."""
        number = self._numbers.get(_key(request))
        return None if number is None else self._answers.get(number)

    def record(self, answer: Answer) -> GaitRequest:
        """Keep an answer of the state machine; return the request that it answers.

        Of the requests with a final answer the oldest are forgotten, never an open one.
        """
        self._answers[answer.request_id] = answer
        request = self._requests[answer.request_id]
        if answer.outcome is not GaitOutcome.ACCEPTED:
            self._finished.append(answer.request_id)
            if len(self._finished) > REMEMBERED:
                oldest = self._finished.popleft()
                del self._answers[oldest], self._numbers[_key(self._requests.pop(oldest))]
        return request


def _key(request: GaitRequest) -> tuple[int, int]:
    return request.header.boot, request.request_id
