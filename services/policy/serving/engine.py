"""What computes a policy's answers: in this process, or anywhere.

An engine keeps nothing between two requests. It may answer at once, late, or not at all; answers
carry the step of their request, and nobody compares clocks.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision

Memory = NDArray[np.float32]


class Request(NamedTuple):
    """Frames of which a decision is wanted.

    Attributes:
        step: number of the service's step in which it is asked.
        observations: (t, n) float32 observation vectors, oldest first.
        pictures: (t, cameras, height, width, 3) uint8 pictures of the policy's cameras.
        memory: the recurrent state before the first of these frames.
    """

    step: int
    observations: NDArray[np.float32]
    pictures: Picture
    memory: Memory


class Answer(NamedTuple):
    """Decision of a request's last frame.

    Attributes:
        step: of the request.
        decision: what the network answers.
        memory: the recurrent state after the last frame.
        seconds: time that the inference took elsewhere [s]; -1: it is a part of the step.
    """

    step: int
    decision: Decision
    memory: Memory
    seconds: float = -1.0


class Engine(Protocol):
    """Computes decisions, one request at a time.

    Attributes:
        refused: answers that were errors or not understood, so far.
        problem: the last of them in words; empty since the last good answer.
        waiting: whether an answer to the last request may still come.
    """

    refused: int
    problem: str
    waiting: bool

    def ask(self, request: Request) -> None:
        """Begin to answer; an older request is forgotten."""

    def answers(self) -> list[Answer]:
        """Return the answers that came since the last call, in the order in which they came."""

    def work(self) -> None:
        """Compute, if it is to be done in this process; called after each step's set-point."""

    def close(self) -> None:
        """Release resources."""


class Runtime(Protocol):
    """Runs a network; see :class:`services.policy.runtimes.runtime.CachingRuntime`."""

    def run(
        self, observations: NDArray[np.float32], pictures: Picture, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it."""


class LocalEngine:
    """Answers in this process.

    Attributes:
        waiting: whether an answer to the last request is still to come.
    """

    refused, problem = 0, ""

    def __init__(self, runtime: Runtime, steps: int = 0) -> None:
        """Answer with ``runtime``.

        Args:
            runtime: runs the network.
            steps: from a request to its answer. 0: at once, and the set-point of the step waits for
                it; otherwise the network runs after that has been sent.
        """
        self.waiting = False
        self._runtime, self._steps = runtime, steps
        self._request: Request | None = None
        self._answer: Answer | None = None
        self._age = 0

    def ask(self, request: Request) -> None:
        """Begin to answer; without delay, compute."""
        self._request, self._answer, self._age = request, None, 0
        self.waiting = True
        if self._steps == 0:
            self._compute()

    def work(self) -> None:
        """Compute what was asked in this step, and count the step."""
        self._compute()
        self._age += 1

    def answers(self) -> list[Answer]:
        """Return the answer to the last request, once, when it is due."""
        if self._answer is None or self._age < self._steps:
            return []
        given, self._answer, self.waiting = self._answer, None, False
        return [given]

    def close(self) -> None:
        """Nothing is held."""

    def _compute(self) -> None:
        if self._request is not None:
            request, self._request = self._request, None
            self._answer = Answer(request.step, *self._runtime.run(*request[1:]))
