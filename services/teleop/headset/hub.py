"""Exchange between the operator's loop and the web server's thread.

Messages of the pages wait in a bounded queue for the operator's next step. In the other direction
there is one slot for the status and one for the pictures: the latest wins, so that a page that is
slow never makes a queue.
"""

import itertools
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from services.teleop.headset.protocol import Incoming

_WAITING = 4096
"""Largest number of messages that wait for a step."""


class Event(NamedTuple):
    """What a page sent, or that it went.

    Attributes:
        page: number of the page.
        message: None: the page has gone.
        arrival_ns: when it came, on the steady clock [ns].
    """

    page: int
    message: Incoming | None
    arrival_ns: int


@dataclass(frozen=True)
class Picture:
    """A stereo picture for the pages.

    Attributes:
        number: counts the pictures.
        stamp: robot time of its capture [ns].
        neck: pitch of the robot's head then [rad].
        age: how old it was at ``at_ns`` [s].
        at_ns: when it was put into the hub [ns].
        left, right: JPEG files.
    """

    number: int
    stamp: int
    neck: float
    age: float
    at_ns: int
    left: bytes
    right: bytes


@dataclass
class Refusals:
    """What the server refused so far.

    Attributes:
        token: connections with a wrong token.
        origin: connections from a page of another site.
        pages: connections beyond the largest number of pages.
        garbage: messages that are none of the protocol.
        oversized: messages that are too large.
        flood: messages beyond the largest rate.
        late: messages that were held up on their way; counted by the operator.
    """

    token: int = 0
    origin: int = 0
    pages: int = 0
    garbage: int = 0
    oversized: int = 0
    flood: int = 0
    late: int = 0


def _nobody_waits() -> None:
    """Stand in for the server's notification while there is no server."""


@dataclass
class Hub:
    """The exchange; every method may be called from any thread.

    Attributes:
        status: what every page is told, as a JSON object.
        replies: what single pages are told besides, by number of the page.
        picture: the newest stereo picture.
        refusals: what the server refused.
        notify: called when there is something new for the pages; set by the server.
    """

    status: Mapping[str, Any] = field(default_factory=dict)
    replies: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    picture: Picture | None = None
    refusals: Refusals = field(default_factory=Refusals)
    notify: Callable[[], None] = _nobody_waits
    _events: deque[Event] = field(default_factory=lambda: deque(maxlen=_WAITING))
    _numbers: "itertools.count[int]" = field(default_factory=lambda: itertools.count(1))

    def new_page(self) -> int:
        """Return a number for a page that has just connected."""
        return next(self._numbers)

    def put(self, event: Event) -> None:
        """Hand the operator what a page sent."""
        self._events.append(event)

    def drain(self) -> list[Event]:
        """Return what the pages sent since the last call, oldest first."""
        events = []
        while self._events:
            events.append(self._events.popleft())
        return events

    def show(self, status: Mapping[str, Any], replies: Mapping[int, Mapping[str, Any]]) -> None:
        """Replace what the pages are told."""
        self.status, self.replies = status, replies
        self.notify()

    def show_picture(self, picture: Picture) -> None:
        """Replace the picture for the pages."""
        self.picture = picture
        self.notify()
