"""The live table: listens to everything on the bus and draws it twice a second.

On a terminal it is a table that redraws itself; elsewhere (a pipe, a log file) a line every few
seconds.
"""

import contextlib
import sys
import time
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live

from common.topics import ALL_TOPICS, JOURNAL
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.session import open_session
from common.transport.tap import RawTap
from deploy.process import terminated_as_interrupted
from lab.monitor.bus_stats import BusStats, Snapshot
from lab.monitor.table import Show, draw, line

SERVICE = "top"
"""Not in the port table on purpose: any number of monitors may watch one system."""
REDRAW_PERIOD = 0.5
LINE_PERIOD = 5.0
TICK = 0.05
"""Between looks at the bus [s]."""


class Watch:
    """A board fed from the bus; a context manager.

    Attributes:
        board: what was heard.
        session: on the bus, while entered.
    """

    def __init__(self, bus: BusConfig) -> None:
        """Prepare to watch ``bus``; nothing is opened yet."""
        self.board = BusStats(bus.robot)
        self._bus = bus

    def __enter__(self) -> "Watch":
        """Open the bus.

        Raises:
            BusError: the bus cannot be opened.
        """
        self.session: Any = open_session(self._bus, SERVICE)
        # Not the journals: who takes a service's first one should be able to keep it.
        shown = [subscription_of(self._bus.robot, t) for t in ALL_TOPICS if t is not JOURNAL]
        self._tap = RawTap(self.session, self._bus.robot, expressions=shown)
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._tap.close()
        self.session.close()

    def look(self) -> Snapshot:
        """Take in what arrived and return everything there is to show."""
        self.board.note(self._tap.drain())
        return self.board.view(time.monotonic_ns())


class Screen:
    """Shows views: a live table on a terminal, else lines; a context manager."""

    def __init__(self, title: str, *, live: bool | None = None, show: Show = Show.ALL) -> None:
        """``live`` forces a table or lines; None decides by the standard output."""
        self._title = title
        self._show = show
        self._console = Console()
        self._live: Live | None = None
        if sys.stdout.isatty() if live is None else live:
            self._live = Live(console=self._console, auto_refresh=False)
        self._due = 0.0

    def __enter__(self) -> "Screen":
        """Take the terminal."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, view: Snapshot) -> None:
        """Draw ``view`` if it is time to; call as often as you like."""
        now = time.monotonic()
        if now < self._due:
            return
        if self._live is not None:
            self._due = now + REDRAW_PERIOD
            # The line below the table is the cursor's.
            room = self._console.size.height - 1
            table = draw(view, self._title, show=self._show, height=room)
            self._live.update(table, refresh=True)
        else:
            self._due = now + LINE_PERIOD
            print(line(view), flush=True)

    def say(self, text: str) -> None:
        """Print ``text`` above the table, or as a line."""
        if self._live is not None:
            self._console.print(text, markup=False, highlight=False)
        else:
            print(text, flush=True)


def watch(bus: BusConfig, title: str, show: Show = Show.ALL) -> None:
    """Show the live table, or only a part of it, until Ctrl-C.

    Raises:
        BusError: the bus cannot be opened.
    """
    with (
        contextlib.suppress(KeyboardInterrupt),
        terminated_as_interrupted(),
        Watch(bus) as seen,
        Screen(title, show=show) as screen,
    ):
        while True:
            screen.show(seen.look())
            time.sleep(TICK)
