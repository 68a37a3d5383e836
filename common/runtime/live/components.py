"""What a live runner does beside stepping its service, one object per concern."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from common.inbox.inbox import Inbox
from common.schemas import Message
from common.topics import Topic

NEVER = 2**63
"""A time out of reach [ns]."""
_REST_NS = 1_000_000_000
"""How long an component that failed is left alone."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunnerContext:
    """Where an component works.

    Attributes:
        session: the open Zenoh session.
        robot: first part of every key.
        service: name of the service.
        boot: random id of this life of it.
        inbox: its inputs; of the service's thread.
        send: publishes a message of the component's own topics; of the service's thread.
        wanted: whether anybody subscribes to one of them just now.
    """

    session: Any
    robot: str
    service: str
    boot: int
    inbox: Inbox
    send: Callable[[Topic[Any], Message], None]
    wanted: Callable[[Topic[Any]], bool]


class Component:
    """One concern of a live runner; everything but callbacks happens in the service's thread.

    Attributes:
        writes: topics it publishes.
        due_ns: when it next wants to be tended even if no step is due [ns, monotonic].
    """

    writes: tuple[Topic[Any], ...] = ()
    due_ns: int = NEVER

    def open(self, context: RunnerContext) -> None:
        """The bus is open and the first step is about to come."""

    def poll(self, now_ns: int) -> None:
        """Do what is due, quickly; called between steps."""

    def report(self) -> dict[str, Any]:
        """Fields for the service's health message."""
        return {}

    def close(self) -> None:
        """The last step is over; the session is closed next."""


class ComponentSet:
    """A service's components; none of them ends its control loop."""

    def __init__(self, components: Iterable[Component]) -> None:
        """Take them on, to be tended in this order."""
        self.all = tuple(components)
        self._rests: dict[Component, int] = {}

    @property
    def due_ns(self) -> int:
        """When the first of them wants to be tended."""
        if self._rests:
            return min(
                max(component.due_ns, self._rests.get(component, 0)) for component in self.all
            )
        return min(component.due_ns for component in self.all)

    def poll(self, now_ns: int, *, only_due: bool = False) -> None:
        """Tend all, or those whose time has come; one that fails is logged and rests a second."""
        for component in self.all:
            if only_due and now_ns < component.due_ns:
                continue
            if self._rests and now_ns < self._rests.get(component, 0):
                continue
            try:
                component.poll(now_ns)
            except Exception:  # noqa: BLE001 - the robot is not to fall for a diagnosis
                _log.exception("%s failed; the service goes on", type(component).__name__)
                self._rests[component] = now_ns + _REST_NS
