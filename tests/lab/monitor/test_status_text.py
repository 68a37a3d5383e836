"""The status of task, robot and authority in the live table."""

import io
from typing import Any

from rich.console import Console

from common.schemas import (
    AuthorityChange,
    AuthorityState,
    GuardMode,
    OperatorKind,
    PolicyMode,
    PolicyState,
    ServiceHealth,
    TaskVerdict,
)
from common.topics import PLANT_STATE, POLICY_STATE, WBC_AUTHORITY
from lab.monitor.bus_stats import BusStats
from lab.monitor.status_text import format_line
from lab.monitor.table import render_table
from tests.lab.monitor.test_bus_stats import sample
from tests.lab.review.synthetic import MS, FakeRobot, Pair
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


def authority(robot: FakeRobot, **changes: Any) -> Pair:
    held: dict[str, Any] = {
        "holder": "keyboard",
        "holder_boot": 5,
        "kind": OperatorKind.PERSON,
        "changes": 2,
        "change": AuthorityChange.TAKEN,
        "previous": "teleop",
        "previous_boot": 4,
        "since": robot.now * MS - 12_000_000_000,
        "waiting": ["teleop", "policy"],
    }
    header = robot.header(WBC_AUTHORITY, "wbc")
    return WBC_AUTHORITY, AuthorityState(header=header, **(held | changes))


def test_table_and_line_show_who_has_the_robot_and_who_waits() -> None:
    robot = FakeRobot()
    robot.now = 20_000
    told = "keyboard has the robot (person), 12 s ago: taken from teleop; waiting: teleop, policy"
    for text in shown(robot.status(), authority(robot)):
        assert told in text
    ignored = authority(robot, ignored=7, waiting=[])
    for text in shown(robot.status(), ignored):
        assert "taken from teleop; messages of others ignored: 7" in text
    nobody = authority(robot, holder="", changes=0, change=AuthorityChange.NONE, waiting=[])
    for text in shown(robot.status(), nobody):
        assert "nobody has the robot" in text
        assert "ago" not in text
    assert "nobody says who has it" in shown(robot.status())[0]


def test_table_and_line_show_a_stop_and_a_foreign_controller() -> None:
    robot = FakeRobot()
    topic, status_ = robot.status()
    stop = {"guard": GuardMode.ESTOP, "stopped_by": "keyboard", "stop_reason": "smoke"}
    for text in shown((topic, status_.model_copy(update=stop))):
        assert "STOPPED by keyboard: smoke (trill resume), guard ESTOP" in text
    foreign = {"commands_foreign": 3, "last_refusal": "wbc (boot 1f): another controller"}
    _, line = shown((topic, status_.model_copy(update=foreign)))
    assert "3 commands of another controller refused, last wbc (boot 1f)" in line


def test_table_and_line_warn_of_doubled_services_and_who_is_ignored() -> None:
    robot = FakeRobot()
    _, state = robot.plant(PLANT_STATE, 0, 0, 0)
    topic, health = robot.health("wbc", misses=0, median=0.002, p99=0.004)
    assert isinstance(health, ServiceHealth)
    link = health.links[0].model_copy(
        update={"foreign": 7, "last_refusal": "message from plant boot b2, following sim boot a1"}
    )
    changes = {"conflict": "another wbc (boot 1f, up 3.0 s)", "links": [link]}
    for text in shown((PLANT_STATE, state), (topic, health.model_copy(update=changes))):
        assert "another wbc (boot 1f, up 3.0 s) is on the bus too" in text
        assert f"wbc ignored 7 of {link.topic}: message from plant boot b2" in text
    assert "on the bus too" not in "".join(shown((PLANT_STATE, state), (topic, health)))


def test_a_held_plant_tells_why_it_applies_no_command() -> None:
    topic, status_ = FakeRobot().status()
    refusal = {"last_refusal": "wbc (boot 5): no emergency stop button is heard"}
    for guard, told in ((GuardMode.SILENT, 1), (GuardMode.HOLD, 1), (GuardMode.ACTIVE, 0)):
        seen = status_.model_copy(update={"guard": guard, **refusal})
        for text in shown((topic, seen)):
            assert text.count("no emergency stop button is heard") == told


def policy_state(robot: FakeRobot, mode: PolicyMode, **changes: Any) -> Pair:
    said: dict[str, Any] = {"policy": "trill", "checkpoint": "ab" * 32, "mode": mode, "answers": 12}
    header = robot.header(POLICY_STATE, "policy")
    return POLICY_STATE, PolicyState(header=header, **(said | changes))


def test_table_and_line_show_what_a_policy_does_and_drops() -> None:
    robot = FakeRobot()
    table, line = shown(
        policy_state(
            robot,
            PolicyMode.DEGRADED,
            label="degraded: no answer in time",
            picture_age=0.01,
            delay=0.26,
            compensated=5,
            round_trip=0.06,
            inference=0.02,
            late=2,
            unanswered=3,
        )
    )
    said = (
        "trill abababab degraded: no answer in time, 12 answers, picture 10 ms, delay 260 ms, "
        "answer 60 ms, inference 20 ms, 5 steps skipped; dropped: late 2, requests without an "
        "answer 3"
    )
    assert f"policy {said}" in line
    assert "policy      trill abababab degraded" in table
    table, line = shown(policy_state(robot, PolicyMode.OK, label="acting", delay=0.02))
    assert "policy trill abababab ok, 12 answers, delay 20 ms" in line
    assert "policy" not in shown(robot.status())[0]
