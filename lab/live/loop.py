"""Show a running system in the live table until it is judged to be over."""

import time
from collections.abc import Callable, Sequence

from deploy.launch import RunningSystem, Verdict
from deploy.process import Exit
from lab.monitor.bus_stats import Snapshot
from lab.monitor.monitor import POLL_PERIOD, BusMonitor, Screen

Judge = Callable[[float, Snapshot, Sequence[Exit]], Verdict | None]
"""Returns the verdict, or None to go on: from time since the start [s], bus and exits."""


def show_until_verdict(
    running: RunningSystem,
    monitor: BusMonitor,
    command: str,
    judge: Judge,
    *,
    on_snapshot: Callable[[Snapshot], str] = lambda _view: "",
    live: bool | None = None,
) -> Verdict:
    """Show bus and processes, under the name ``command``, until ``judge`` has a verdict.

    ``on_snapshot`` is called with every snapshot, and a text that it returns is printed. ``live``
    forces (or forbids) the live table; None decides by the terminal.
    """
    supervisor, started = running.supervisor, time.monotonic()
    with Screen(f"{command}  {running.title}", live=live) as screen:
        screen.say(f"{running.title}: running {', '.join(supervisor.running())}")
        while True:
            view = monitor.poll()
            screen.show(view)
            if text := on_snapshot(view):
                screen.say(text)
            exits = supervisor.poll()
            for ended in exits:
                if not ended.expected:
                    screen.say(ended.describe())
            verdict = judge(time.monotonic() - started, view, exits)
            if verdict is not None:
                return verdict
            time.sleep(POLL_PERIOD)


def essential_exit(exits: Sequence[Exit]) -> Verdict | None:
    """Return the verdict on the first essential process that ended for good; None without one."""
    for ended in exits:
        if ended.essential and not ended.restarted:
            if ended.expected:
                return Verdict("completed")
            return Verdict("service died", ended.describe())
    return None
