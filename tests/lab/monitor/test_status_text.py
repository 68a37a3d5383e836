"""The status of a scored task in the live table."""

import io

from rich.console import Console

from common.schemas import TaskVerdict
from lab.monitor.bus_stats import BusStats
from lab.monitor.status_text import format_line
from lab.monitor.table import render_table
from tests.lab.monitor.test_bus_stats import sample
from tests.lab.review.synthetic import FakeRobot, Pair
from tests.lab.review.synthetic_task import status


def shown(*pairs: Pair) -> tuple[str, str]:
    """Table and line after these messages."""
    stats = BusStats("draco3")
    stats.add(sample(pair, at=float(i)) for i, pair in enumerate(pairs))
    seen = stats.snapshot(now_ns=len(pairs) * 1_000_000_000)
    console = Console(width=150, file=io.StringIO(), record=True)
    console.print(render_table(seen, "title"))
    return console.export_text(), format_line(seen)


def test_table_and_line_show_the_status_of_the_task() -> None:
    robot = FakeRobot()
    touched = status(robot, 1, time=12.3, touched=("left wrist on jamb",))
    table, line = shown(robot.status(), touched)
    assert "task        door/unlock seed 7  12.3/60 s  RUNNING  stage 1/3: lever pressed" in table
    assert "undesired: left wrist on jamb" in table
    assert (
        "door/unlock seed 7  12.3/60 s RUNNING, stage 1/3: lever pressed, next: door ajar, "
        "undesired: left wrist on jamb"
    ) in line
    table, line = shown(status(robot, 3, TaskVerdict.PARTIAL))
    assert "PARTIAL: it was a partial, stage 3/3: door unlocked, no undesired contact" in line
    table, line = shown(robot.status())
    assert "task" not in table
    assert "seed" not in line
