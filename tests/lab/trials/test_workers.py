"""Workers that are killed or stopped: the others go on, a message says so, another replaces it."""

import atexit
import os
import signal
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from common.program import signals_as_keyboard_interrupt
from lab.trials.workers import LocalExecutor, stop_request, worker_environment


def pid() -> int:
    return os.getpid()


def busy(seconds: float) -> int:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not stop_request().is_set():
        time.sleep(0.01)
    return os.getpid()


def clear_up_at_exit(file: str) -> int:
    atexit.register(Path(file).touch)
    return os.getpid()


def test_a_killed_worker_is_lost_alone_and_replaced() -> None:
    workers = LocalExecutor(2)
    try:
        first, second = workers.submit(busy, 600.0), workers.submit(pid)
        survivor = second.result(60.0)
        other = workers.submit(busy, 2.0)
        (victim,) = set(workers.pids) - {survivor}
        os.kill(victim, signal.SIGKILL)
        with pytest.raises(BrokenProcessPool):
            first.result(60.0)
        assert other.result(60.0) == survivor
        assert {workers.submit(pid).result(60.0), survivor, victim} != {survivor, victim}
    finally:
        workers.end()


def test_a_stopped_worker_is_reported_then_killed() -> None:
    workers = LocalExecutor(1, silence=2.0, patience=10.0)
    try:
        stopped = workers.submit(pid).result(60.0)
        assert workers.pids == [stopped]
        future = workers.submit(busy, 600.0)
        os.kill(stopped, signal.SIGSTOP)
        messages: list[str] = []
        while not future.done():
            messages += workers.watch()
            time.sleep(0.1)
        assert isinstance(future.exception(), BrokenProcessPool)
        assert ["kill -CONT" in text for text in messages] == [True, False]
        assert "killed" in messages[1]
    finally:
        workers.end()


def wait_until_gone(process: int) -> None:
    until = time.monotonic() + 20.0
    while Path(f"/proc/{process}").exists():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_the_end_does_not_wait_for_a_stopped_worker() -> None:
    workers = LocalExecutor(1)
    stopped = workers.submit(pid).result(60.0)
    workers.submit(busy, 600.0)
    os.kill(stopped, signal.SIGSTOP)
    workers.end()
    wait_until_gone(stopped)


def test_the_end_does_not_wait_until_an_idle_worker_has_cleared_up(tmp_path: Path) -> None:
    workers = LocalExecutor(1)
    idle = workers.submit(clear_up_at_exit, str(tmp_path / "cleared")).result(60.0)
    workers.end()
    wait_until_gone(idle)
    assert not (tmp_path / "cleared").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_request_to_end_waits_until_a_worker_has_begun(number: signal.Signals) -> None:
    """Also when another thread takes the signal, as those of libraries do."""
    go, reached = threading.Event(), False

    def take() -> None:
        go.wait()
        signal.raise_signal(number)

    thread = threading.Thread(target=take)
    thread.start()
    ended, program = pytest.raises(KeyboardInterrupt), signals_as_keyboard_interrupt()
    with ended, program, worker_environment():
        go.set()
        thread.join()
        reached = True
    assert reached
