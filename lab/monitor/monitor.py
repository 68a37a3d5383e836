"""Watch a running system from any terminal: ``trill top``.

A terminal shows a table that is redrawn twice a second; a pipe or file gets a line every few
seconds.
"""

import contextlib
import sys
import time
from collections.abc import Iterator
from typing import Any

from rich.console import Console
from rich.live import Live

from common.program import signals_as_keyboard_interrupt
from common.topics import ALL_TOPICS, JOURNAL
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.session import open_session
from common.transport.tap import RawTap
from lab.monitor.bus_stats import BusStats, Snapshot
from lab.monitor.status_text import format_line
from lab.monitor.table import Content, render_table

NAME = "top"
"""Not in the table of services on purpose: any number of monitors may watch one system."""
REDRAW_PERIOD = 0.5
"""Between two tables [s]."""
LINE_PERIOD = 5.0
"""Between two lines [s]."""
POLL_PERIOD = 0.05
"""Between two polls of the bus [s]."""


class BusMonitor:
    """Subscribes to every topic of a bus on ``session`` and keeps statistics."""

    def __init__(self, session: Any, robot: str) -> None:
        """Subscribe on ``session`` to the topics of ``robot``."""
        self.session = session
        self._stats = BusStats(robot)
        # Not to the journals: the first journal of a service is sent only when somebody
        # subscribes, and that should be a logger, which keeps it.
        shown = [subscription_of(robot, topic) for topic in ALL_TOPICS if topic is not JOURNAL]
        self._tap = RawTap(session, robot, expressions=shown)

    def poll(self) -> Snapshot:
        """Count what has arrived and return everything there is to show."""
        self._stats.add(self._tap.drain())
        return self._stats.snapshot(time.monotonic_ns())

    def close(self) -> None:
        """Unsubscribe and close the session."""
        self._tap.close()
        self.session.close()


@contextlib.contextmanager
def monitored(bus: BusConfig) -> Iterator[BusMonitor]:
    """Open a :class:`BusMonitor` of a bus for the time of a context.

    Raises:
        BusError: the bus cannot be opened.
    """
    with contextlib.closing(BusMonitor(open_session(bus, NAME), bus.robot)) as monitor:
        yield monitor


class Screen:
    """Shows snapshots as a live table on a terminal, else as lines; a context manager."""

    def __init__(
        self, title: str, *, live: bool | None = None, content: Content = Content.ALL
    ) -> None:
        """Prepare; ``live`` forces (or forbids) a table, None decides by standard output."""
        self._title = title
        self._content = content
        self._console = Console()
        self._live: Live | None = None
        if sys.stdout.isatty() if live is None else live:
            self._live = Live(console=self._console, auto_refresh=False)
        self._due = 0.0

    def __enter__(self) -> "Screen":
        """Start the live table."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Stop the live table; its last state stays on the terminal."""
        if self._live is not None:
            self._live.stop()

    def show(self, view: Snapshot) -> None:
        """Draw ``view``; calls more frequent than the table's or the lines' period are ignored."""
        now = time.monotonic()
        if now < self._due:
            return
        if self._live is None:
            self._due = now + LINE_PERIOD
            print(format_line(view), flush=True)
            return
        self._due = now + REDRAW_PERIOD
        # The last line of the terminal is the cursor's.
        height = self._console.size.height - 1
        table = render_table(view, self._title, content=self._content, height=height)
        self._live.update(table, refresh=True)

    def say(self, text: str) -> None:
        """Print ``text`` above the table, or as a line."""
        if self._live is not None:
            self._console.print(text, markup=False, highlight=False)
        else:
            print(text, flush=True)


def watch(bus: BusConfig, title: str, content: Content = Content.ALL) -> None:
    """Show the live table, or one part of it, until Ctrl-C.

    Raises:
        BusError: the bus cannot be opened.
    """
    with (
        contextlib.suppress(KeyboardInterrupt),
        signals_as_keyboard_interrupt(),
        monitored(bus) as monitor,
        Screen(title, content=content) as screen,
    ):
        while True:
            screen.show(monitor.poll())
            time.sleep(POLL_PERIOD)
