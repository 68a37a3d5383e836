"""What a live runner does beside stepping its service, one object per concern."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from common.bus.inbox import Inbox
from common.schemas import Message
from common.topics import Topic

NEVER = 2**63
"""A time out of reach [ns]."""


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
