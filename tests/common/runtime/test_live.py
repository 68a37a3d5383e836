"""Real processes on loopback: any starting order, restarts, frozen readers, clean exits."""

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.schemas import LinkHealth, ServiceHealth
from common.topics import HEALTH, PLANT_STATE, WBC_COMMAND
from common.transport.config import BusConfig
from common.transport.session import open_session
from tests.common.transport.support import free_base_port

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 30.0
TOPICS = (PLANT_STATE, WBC_COMMAND, HEALTH)


class Stack:
    """Toy services as processes, and a monitor that listens to them."""

    def __init__(self) -> None:
        self.config = BusConfig(base_port=free_base_port())
        self.processes: list[subprocess.Popen[str]] = []
        self.session: Any = open_session(self.config, "monitor")
        self.inbox = Inbox(TOPICS)
        self._subscribers = subscribe(self.session, self.config.robot, self.inbox, TOPICS)

    def start(self, name: str, kind: str, *options: str) -> "subprocess.Popen[str]":
        environment = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
        environment |= {"TOY_NAME": name, "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-m", "tests.common.runtime.toys", "--kind", kind]
        command += ["--base-port", str(self.config.base_port), "--rt-priority", "0", *options]
        process = subprocess.Popen(
            command, env=environment, cwd=ROOT, stderr=subprocess.PIPE, text=True
        )
        self.processes.append(process)
        return process

    def until(self, condition: Callable[[], bool]) -> bool:
        """Take in messages until the condition holds; False after a long time."""
        give_up = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up:
            self.inbox.begin_step(time.monotonic_ns())
            if condition():
                return True
            time.sleep(0.01)
        return False

    def loop_closed(self) -> bool:
        """The controller answers the plant: both hear each other, and the monitor both."""
        return self.inbox.fresh(PLANT_STATE) and self.inbox.updated(WBC_COMMAND)

    def health(self, name: str) -> ServiceHealth | None:
        latest = self.inbox.latest_by_sender(HEALTH)
        return next((m for sender, m in latest.items() if sender.source == name), None)

    def link(self, name: str, topic: str) -> LinkHealth | None:
        health = self.health(name)
        links = health.links if health is not None else []
        return next((link for link in links if link.topic == topic), None)

    def stop(self) -> None:
        self._subscribers.clear()
        self.session.close()
        for process in self.processes:
            process.kill()
            process.communicate()


@pytest.fixture
def stack() -> Iterator[Stack]:
    running = Stack()
    yield running
    running.stop()


@pytest.mark.parametrize("first", ["sim", "wbc"])
def test_starting_order_does_not_matter(stack: Stack, first: str) -> None:
    kinds = {"sim": "plant", "wbc": "controller"}
    stack.start(first, kinds.pop(first))
    assert stack.until(lambda: stack.health(first) is not None)
    ((second, kind),) = kinds.items()
    stack.start(second, kind)
    assert stack.until(stack.loop_closed)
    command = stack.inbox.latest(WBC_COMMAND)
    assert command is not None
    # Made from a state: the stamp the plant gave it came back.
    assert command.header.stamp > 0


@pytest.mark.parametrize("victim", ["sim", "wbc"])
def test_killed_service_is_found_again_after_restart(stack: Stack, victim: str) -> None:
    kinds = {"sim": "plant", "wbc": "controller"}
    processes = {name: stack.start(name, kind) for name, kind in kinds.items()}
    assert stack.until(stack.loop_closed)
    processes[victim].kill()
    processes[victim].wait()
    topic = PLANT_STATE if victim == "sim" else WBC_COMMAND
    assert stack.until(lambda: not stack.inbox.fresh(topic))
    before = stack.inbox.health_of(topic)
    last: Any = stack.inbox.latest(topic)
    stack.start(victim, kinds[victim])
    assert stack.until(stack.loop_closed)
    message: Any = stack.inbox.latest(topic)
    assert message.header.boot != last.header.boot
    assert stack.inbox.health_of(topic).gaps == before.gaps


def test_frozen_subscriber_does_not_hold_up_the_publisher(stack: Stack, tmp_path: Path) -> None:
    # So long a lease that the frozen reader stays a member while its link fills up.
    config = tmp_path / "stack.toml"
    config.write_text("[bus]\nlease_ms = 20000\n")
    stack.start("sim", "filming", "--config", str(config))
    controller = stack.start("wbc", "watching", "--config", str(config))
    assert stack.until(stack.loop_closed)
    stamps: list[int] = []

    def collect() -> bool:
        state = stack.inbox.latest(PLANT_STATE)
        if state is not None and stack.inbox.updated(PLANT_STATE):
            stamps.append(state.header.stamp)
        return len(stamps) > 1 and stamps[-1] - stamps[0] > 6_000_000_000

    controller.send_signal(signal.SIGSTOP)
    try:
        before = stack.inbox.health_of(PLANT_STATE).gaps
        assert stack.until(collect)
    finally:
        controller.send_signal(signal.SIGCONT)
    # On the plant's own clock: a publisher that blocks would stand still for five seconds.
    assert max(b - a for a, b in itertools.pairwise(stamps)) < 1_000_000_000
    assert stack.inbox.health_of(PLANT_STATE).gaps == before
    assert stack.until(stack.loop_closed)


def test_health_tells_steps_timing_and_links(stack: Stack) -> None:
    stack.start("sim", "plant")
    stack.start("wbc", "controller")

    def told() -> bool:
        health, link = stack.health("wbc"), stack.link("wbc", "plant/state")
        if health is None or link is None or link.received <= 100:
            return False
        # States at 200 Hz start steps at 100 Hz; a plant that is late at its start sends fewer.
        return health.steps / link.received < 0.75

    assert stack.until(told)
    health, link = stack.health("wbc"), stack.link("wbc", "plant/state")
    assert health is not None
    assert link is not None
    assert health.period == 0.01
    assert health.steps >= 20
    assert 0.0 < health.step_median <= health.step_p99
    assert health.realtime == "normal"
    assert health.header.source == "wbc"
    assert (link.gaps, link.refused) == (0, 0)
    gaits = stack.link("wbc", "teleop/gait")
    assert gaits is not None
    assert (gaits.received, gaits.age) == (0, -1.0)


def test_injected_delay_ages_the_state_by_that_much(stack: Stack) -> None:
    stack.start("sim", "plant")
    stack.start("wbc", "controller", "--link", "plant/state=150ms")
    ages: list[float] = []

    def collect() -> bool:
        command = stack.inbox.latest(WBC_COMMAND)
        if command is not None and stack.inbox.updated(WBC_COMMAND):
            # Both clocks are this machine's monotonic clock.
            ages.append(1e-9 * (command.header.sent - command.header.stamp))
        return len(ages) >= 50

    assert stack.until(collect)
    assert min(ages) >= 0.150
    assert min(ages) < 0.300


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_ends_cleanly(stack: Stack, number: signal.Signals) -> None:
    process = stack.start("sim", "plant", "--link", "wbc/command=5ms")
    assert stack.until(lambda: stack.health("sim") is not None)
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "Traceback" not in errors
    assert "sim is on the bus of draco3, scheduling: normal" in errors
    assert "the toy plant is closed" in errors
    assert "input wbc/command has a link of 5ms" in errors
    assert "link of wbc/command: mean 5.0 ms requested" in errors


@pytest.mark.parametrize(
    ("kind", "complaint"),
    [
        ("failing", "RuntimeError: broken on purpose"),
        ("undeclared", "expected one of its `writes`: none"),
    ],
)
def test_failing_step_ends_the_process_with_a_traceback(
    stack: Stack, kind: str, complaint: str
) -> None:
    process = stack.start("sim", kind)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert complaint in errors
    assert "Traceback" in errors
    assert "the toy plant is closed" in errors


def test_taken_port_ends_the_process(stack: Stack) -> None:
    stack.start("wbc", "controller")
    assert stack.until(lambda: stack.health("wbc") is not None)
    second = stack.start("wbc", "controller")
    _, errors = second.communicate(timeout=PATIENCE_S)
    assert second.returncode == 1
    assert "choose another base port" in errors
    assert "Traceback" not in errors
