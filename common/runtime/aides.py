"""What a live runner does beside stepping its service, one object per concern."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from common.bus.inbox import Inbox
from common.schemas import Message
from common.topics import Topic

NEVER = 2**63
"""A time out of reach [ns]."""
_REST_NS = 1_000_000_000
"""How long an aide that failed is left alone."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Place:
    """Where an aide works.

    Attributes:
        session: the open Zenoh session.
        robot: first part of every key.
        service: name of the service.
        boot: random id of this life of it.
        inbox: its inputs; of the service's thread.
        send: publishes a message of the aide's own topics; of the service's thread.
        wanted: whether anybody subscribes to one of them just now.
    """

    session: Any
    robot: str
    service: str
    boot: int
    inbox: Inbox
    send: Callable[[Topic[Any], Message], None]
    wanted: Callable[[Topic[Any]], bool]


class Aide:
    """One concern of a live runner; everything but callbacks happens in the service's thread.

    Attributes:
        writes: topics it publishes.
        due_ns: when it next wants to be tended even if no step is due [ns, monotonic].
    """

    writes: tuple[Topic[Any], ...] = ()
    due_ns: int = NEVER

    def open(self, place: Place) -> None:
        """The bus is open and the first step is about to come."""

    def tend(self, now_ns: int) -> None:
        """Do what is due, quickly; called between steps."""

    def report(self) -> dict[str, Any]:
        """Fields for the service's health message."""
        return {}

    def close(self) -> None:
        """The last step is over; the session is closed next."""


class Crew:
    """A service's aides; none of them ends its control loop."""

    def __init__(self, aides: Iterable[Aide]) -> None:
        """Take them on, to be tended in this order."""
        self.all = tuple(aides)
        self._rests: dict[Aide, int] = {}

    @property
    def due_ns(self) -> int:
        """When the first of them wants to be tended."""
        if self._rests:
            return min(max(aide.due_ns, self._rests.get(aide, 0)) for aide in self.all)
        return min(aide.due_ns for aide in self.all)

    def tend(self, now_ns: int, *, only_due: bool = False) -> None:
        """Tend all, or those whose time has come; one that fails is logged and rests a second."""
        for aide in self.all:
            if only_due and now_ns < aide.due_ns:
                continue
            if self._rests and now_ns < self._rests.get(aide, 0):
                continue
            try:
                aide.tend(now_ns)
            except Exception:  # noqa: BLE001 - the robot is not to fall for a diagnosis
                _log.exception("%s failed; the service goes on", type(aide).__name__)
                self._rests[aide] = now_ns + _REST_NS
