"""When a policy asks for a gait: an event, not a part of the set-points; pure.

A policy says in every frame how probable a request is. Demonstrations have one request in dozens
of frames, at a moment that varies, so that a frame's probability is small; what counts is how much
of it gathers while the robot balances.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from common.schemas import ControllerState, ControlState, Gait, GaitOutcome, GaitReply, GaitRequest
from services.policy.serving.config import TriggerConfig


class GaitTrigger:
    """Turns probabilities of gaits into requests, one at a time.

    Attributes:
        requested: requests so far.
    """

    def __init__(self, config: TriggerConfig, hazard_frames: int, period: float) -> None:
        """Request nothing yet.

        Args:
            config: when to.
            hazard_frames: frames before a request that the policy was taught to take for one.
            period: time from one step to the next [s].
        """
        self.requested = 0
        self._config = config
        self._frames = max(1, hazard_frames)
        self._hold_off = round(config.hold_off / period)
        self._patience = round(config.patience / period)
        self._next_id = 0
        self._pending: int | None = None
        self._balancing = 0
        self._balanced = False
        self._open_from = 0
        self._boot = 0
        self._last = -1
        self._gathered = np.zeros(len(Gait))

    def begin(self, step: int, first_id: int) -> None:
        """Begin anew in ``step``; ids of requests are at least ``first_id``."""
        self._next_id = max(self._next_id, first_id)
        self._end(step)
        self._open_from = step

    def update(self, step: int, controller: ControllerState, replies: Iterable[GaitReply]) -> None:
        """Take in the controller's state and its replies to own requests, in every step."""
        self._balanced = controller.state is ControlState.BALANCE and controller.gait is Gait.NONE
        self._boot = controller.header.boot
        self._balancing = self._balancing + 1 if self._balanced else 0
        if not self._balanced:
            self._end(step, pending=self._pending)
        final = {r.request_id for r in replies if r.outcome is not GaitOutcome.ACCEPTED}
        # A reply may be lost; the robot that balances on shows that no gait goes on.
        lost = self._balancing > self._patience
        if self._pending is not None and (self._pending in final or lost):
            self._end(step)

    def decide(self, probabilities: NDArray[np.float32], asked: int) -> GaitRequest | None:
        """Return a request if enough has gathered.

        Args:
            probabilities: (7,) of no gait and of each gait, of the frame seen in step ``asked``.
                What was seen before the end of the last gait does not count, however late it
                comes: a step forward is not repeated because the word of it travelled slowly.
            asked: step in which the policy was asked.
        """
        frames = asked - max(self._last, self._open_from - 1)
        self._last = max(self._last, asked)
        if self._pending is not None or not self._balanced or frames <= 0:
            return None
        if self._config.rule == "threshold":
            self._gathered = np.asarray(probabilities, dtype=np.float64)
        else:
            self._gathered += probabilities * (frames / self._frames)
        if self._gathered[1:].sum() < self._config.level:
            return None
        gait = Gait(1 + int(np.argmax(self._gathered[1:])))
        self._pending, self._next_id, self._balancing = self._next_id, self._next_id + 1, 0
        self.requested += 1
        return GaitRequest(request_id=self._pending, gait=gait, controller_boot=self._boot)

    def _end(self, step: int, pending: int | None = None) -> None:
        """Forget what has gathered; nothing gathers again before the hold-off is over."""
        self._pending = pending
        self._open_from = step + self._hold_off
        self._gathered = np.zeros(len(Gait))
