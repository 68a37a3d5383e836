"""Model of a person who operates the robot: manipulation, and buttons for gaits."""

from collections.abc import Sequence

import numpy as np

from common.schemas import Gait, GaitOutcome, GaitReply
from services.teleop.headset.mapping import GAIT_BUTTONS
from services.teleop.synthetic.body import Act, Condition, StrategyError
from services.teleop.synthetic.manipulation import Goal, Manipulation
from services.teleop.synthetic.observation import Observation
from services.teleop.synthetic.traits import OperatorTraits

__all__ = ["Act", "Condition", "Goal", "OperatorModel", "StrategyError"]

_BUTTON_OF = {gait: button for button, gait in GAIT_BUTTONS.items()}


class OperatorModel(Manipulation):
    """An operator that also requests gaits and receives the controller's replies."""

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, seen: Observation) -> None:
        super().__init__(traits, rng, seen)
        self._replies: list[GaitReply] = []

    def perceive(
        self, seen: Observation, replies: Sequence[GaitReply], time: float, dt: float
    ) -> None:
        """Take in an observation and the replies that came with it."""
        self.observe(seen, time, dt)
        self._replies += replies

    def gait(self, gait: Gait, tries: int = 6) -> Act:
        """Press the button of a gait and wait until the gait is seen to be completed.

        Raises:
            StrategyError: the gait was refused or not answered too often, or aborted.
        """
        for _ in range(tries):
            self._replies.clear()
            before = self.seen.completed
            self.button = _BUTTON_OF[gait]
            yield from self.pause(self.traits.press_time)
            self.button = None
            yield
            outcome = yield from self._await_gait(gait, before)
            if outcome:
                return True
            yield from self.pause(self.vary(0.4, 0.1))
        raise StrategyError(f"{gait.name.lower()} was not completed after {tries} presses")

    def _await_gait(self, gait: Gait, before: int) -> Act:
        began, walking = self.time, False
        while True:
            for reply in self._replies:
                if reply.gait is not gait:
                    continue
                if reply.outcome is GaitOutcome.REFUSED and not walking:
                    self._replies.clear()
                    return False
                if reply.outcome is GaitOutcome.ABORTED:
                    raise StrategyError(f"{gait.name.lower()} was aborted: {reply.reason}")
                walking = True
            self._replies.clear()
            walking = walking or not self.seen.balancing
            if self.seen.completed > before and self.seen.balancing:
                return True
            waited = self.time - began
            if not walking and waited > 2.0 * self.lag + self.traits.answer_patience:
                return False
            if waited > 30.0:
                raise StrategyError(f"{gait.name.lower()} did not end within 30 s")
            yield
