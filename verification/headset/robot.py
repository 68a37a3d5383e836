"""The running robot as the checks see it: messages of the bus, the newest of each topic."""

import asyncio
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any, TypeVar

from common.errors import TrillError
from common.schemas import ControlState, Message
from common.topics import (
    PLANT_STATUS,
    TELEOP_DEVICE,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_STATE,
    WBC_TARGET,
    Topic,
)
from common.transport.config import BusConfig
from common.transport.session import open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import decode

NAME = "verify-headset"
PATIENCE = 20.0
"""Time in which what is waited for has to come [s]."""
TOPICS: tuple[Topic[Any], ...] = (
    TELEOP_SETPOINT,
    TELEOP_DEVICE,
    WBC_STATE,
    WBC_AUTHORITY,
    WBC_TARGET,
    PLANT_STATUS,
)
M = TypeVar("M", bound=Message)


class CheckError(TrillError):
    """A promise is broken."""


class Robot:
    """Listens on the bus."""

    def __init__(self, bus: BusConfig) -> None:
        self._newest: dict[str, Any] = {}
        self.counts: dict[str, int] = defaultdict(int)
        self._session: Any = open_session(bus, NAME)
        self._topics = {f"{bus.robot}/{topic.name}": topic for topic in TOPICS}
        self._tap = RawTap(
            self._session, bus.robot, deliver=self._receive, expressions=list(self._topics)
        )

    def close(self) -> None:
        """Leave the bus."""
        self._tap.close()
        self._session.close()

    def _receive(self, sample: RawSample) -> None:
        topic = self._topics[sample.key]
        self._newest[topic.name] = decode(sample.payload, topic.schema)
        self.counts[topic.name] += 1

    @property
    def balances(self) -> bool:
        """Whether the controller is heard, and balances."""
        state = self.latest(WBC_STATE)
        return state is not None and state.state is ControlState.BALANCE

    def latest(self, topic: Topic[M]) -> M | None:
        """Return the newest message of a topic; None: none yet."""
        message: M | None = self._newest.get(topic.name)
        return message

    async def next(self, topic: Topic[M]) -> M:
        """Return a message that has come since the call.

        Raises:
            CheckError: none comes.
        """
        before = self.counts[topic.name]
        await until(lambda: self.counts[topic.name] > before + 1, f"a message of {topic.name}")
        message = self.latest(topic)
        assert message is not None
        return message


async def until(holds: Callable[[], bool], what: str, patience: float = PATIENCE) -> None:
    """Wait until something holds.

    Raises:
        CheckError: it does not in time.
    """
    deadline = time.monotonic() + patience
    while not holds():
        if time.monotonic() > deadline:
            raise CheckError(f"waited {patience:g} s for {what}")
        await asyncio.sleep(0.02)
