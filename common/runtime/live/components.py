"""Run the concerns of a live runner besides stepping its service, one component for each."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from common.inbox.inbox import Inbox
from common.schemas import Message
from common.topics import Topic

NEVER = 2**63
"""A time out of reach [ns]."""
_DISABLED_NS = 1_000_000_000
"""How long a component that raised is not polled."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunnerContext:
    """What a component has to work with.

    Attributes:
        session: the open Zenoh session.
        robot: first part of every key.
        service: name of the service.
        boot: random id of this run of it.
        inbox: its inputs; for the service's thread.
        send: publishes a message of the component's own topics; for the service's thread.
        wanted: whether there is a subscriber to one of them just now.
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
        due_ns: when it next needs to be polled even if no step is due [ns, monotonic].
    """

    writes: tuple[Topic[Any], ...] = ()
    due_ns: int = NEVER

    def open(self, context: RunnerContext) -> None:
        """Start; the bus is open and the first step is about to come."""

    def poll(self, now_ns: int) -> None:
        """Do what is due, quickly; called between steps."""

    def report(self) -> dict[str, Any]:
        """Return fields for the service's health message."""
        return {}

    def close(self) -> None:
        """Stop; the last step is over and the session is closed next."""


class ComponentSet:
    """A service's components; one that raises is disabled for a second and never stops the loop.

    Attributes:
        all: the components, in the order in which they are polled.
    """

    def __init__(self, components: Iterable[Component]) -> None:
        self.all = tuple(components)
        self._disabled_until: dict[Component, int] = {}

    @property
    def writes(self) -> tuple[Topic[Any], ...]:
        """Topics that they publish."""
        return tuple(topic for component in self.all for topic in component.writes)

    @property
    def due_ns(self) -> int:
        """When the first of them needs to be polled [ns]."""
        if self._disabled_until:
            return min(
                max(component.due_ns, self._disabled_until.get(component, 0))
                for component in self.all
            )
        return min(component.due_ns for component in self.all)

    def poll(self, now_ns: int, *, only_due: bool = False) -> None:
        """Poll all components, or those that are due; one that raises is logged and disabled."""
        for component in self.all:
            if only_due and now_ns < component.due_ns:
                continue
            if self._disabled_until and now_ns < self._disabled_until.get(component, 0):
                continue
            try:
                component.poll(now_ns)
            except Exception:  # noqa: BLE001 - the robot must not fall because of a diagnosis
                _log.exception("%s failed; the service goes on", type(component).__name__)
                self._disabled_until[component] = now_ns + _DISABLED_NS
