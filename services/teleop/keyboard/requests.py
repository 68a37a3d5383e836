"""The gait requests that the keyboard operator has sent, in words; pure."""

from dataclasses import dataclass

from common.schemas import Gait, GaitOutcome

ANSWER_EXPECTED = 2.0
"""Time after which a gait request is shown as unanswered [s]."""


@dataclass(frozen=True)
class SentRequest:
    """A gait request and its latest answer.

    Attributes:
        request_id: of the request.
        gait: requested.
        since: operator's time of the last change [s].
        outcome: None before any answer.
        reason: of a refusal or abortion.
    """

    request_id: int
    gait: Gait
    since: float
    outcome: GaitOutcome | None = None
    reason: str = ""

    def describe(self, now: float) -> str:
        """Return one line for the screen; ``now`` is the operator's time [s]."""
        name = self.gait.name.lower().replace("_", " ")
        if self.outcome is None:
            waited = now - self.since
            silent = waited > ANSWER_EXPECTED
            return f"{name}: {f'NO ANSWER for {waited:.0f} s' if silent else 'asked'}"
        if self.outcome in {GaitOutcome.REFUSED, GaitOutcome.ABORTED}:
            return f"{name}: {self.outcome.name} - {self.reason or 'no reason given'}"
        return f"{name}: {self.outcome.name.lower()}"
