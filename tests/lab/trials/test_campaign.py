"""One campaign: order of results, lost workers, refused keys, and its end in every case."""

import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import pytest

from common.errors import TrillError
from lab.errors import LabError
from lab.trials.campaign import run_campaign
from tests.lab.trials.fake_executor import FakeExecutor


class BusyExecutor(FakeExecutor):
    """Counts how many trials were under way at most."""

    def __init__(self, size: int) -> None:
        super().__init__(size=size)
        self.most, self._futures = 0, list[Future[Any]]()

    def submit(self, work: Callable[..., Any], /, *arguments: object) -> "Future[Any]":
        self._futures.append(super().submit(work, *arguments))
        self.most = max(self.most, sum(not future.done() for future in self._futures))
        return self._futures[-1]


class LateExecutor(FakeExecutor):
    """Returns the last of eight futures only when all of them are done."""

    def submit(self, work: Callable[..., Any], /, *arguments: object) -> "Future[Any]":
        future = super().submit(work, *arguments)
        if len(self.given) == 8:
            self.end()
        return future


def double(key: int) -> int:
    time.sleep(0.001)
    return 2 * key


def test_every_key_gets_its_result_and_no_more_run_than_there_are_workers() -> None:
    executor, results = BusyExecutor(3), dict[int, int]()
    run_campaign(range(50), double, executor, on_result=results.__setitem__)
    assert results == {key: 2 * key for key in range(50)}
    assert 1 <= executor.most <= 3
    assert executor.ended


def test_results_that_arrive_together_come_in_the_order_of_their_keys() -> None:
    order: list[int] = []
    run_campaign(
        range(8), double, LateExecutor(size=8), on_result=lambda key, _result: order.append(key)
    )
    assert order == list(range(8))


def losing(losses: dict[int, int]) -> FakeExecutor:
    """An executor that loses workers with some keys, so many with each."""
    left = Counter(losses)

    def loses(key: int) -> bool:
        left[key] -= 1
        return left[key] >= 0

    return FakeExecutor(size=1, loses=loses)


def test_a_key_whose_worker_is_lost_is_run_again() -> None:
    results: list[int] = []
    messages: list[str] = []
    run_campaign(
        range(6),
        double,
        losing({1: 2, 4: 1}),
        on_result=lambda key, _result: results.append(key),
        on_message=messages.append,
    )
    assert sorted(results) == list(range(6))
    assert sorted(text.split()[3] for text in messages) == ["1", "1", "4"]


def test_a_key_that_loses_three_workers_ends_the_campaign() -> None:
    executor, results = losing({3: 99}), list[int]()
    with pytest.raises(LabError, match="3 has cost 3 workers") as ended:
        run_campaign(range(6), double, executor, on_result=lambda key, _result: results.append(key))
    assert isinstance(ended.value.__cause__, ConnectionError)
    assert results == [0, 1, 2]
    assert executor.ended


def test_no_key_is_started_or_drawn_after_a_refused_one() -> None:
    drawn: list[int] = []
    results: list[int] = []
    under_way: list[int] = []

    def keys() -> Iterator[int]:
        for key in range(100):
            drawn.append(key)
            yield key

    def may_start(key: int, others: int) -> bool:
        under_way.append(others)
        return len(results) + others < 5

    run_campaign(
        keys(),
        double,
        FakeExecutor(),
        on_result=lambda key, _result: results.append(key),
        may_start=may_start,
    )
    assert sorted(results) == [0, 1, 2, 3, 4]
    assert drawn == [0, 1, 2, 3, 4, 5]
    assert set(under_way) <= {0, 1}


class SimulationError(TrillError):
    """Error of a trial."""


@pytest.mark.parametrize(
    ("place", "error"),
    [
        ("work", SimulationError),
        ("work", ZeroDivisionError),
        ("on_result", SimulationError),
        ("on_result", KeyboardInterrupt),
    ],
)
def test_an_error_ends_the_workers_and_is_raised(place: str, error: type[BaseException]) -> None:
    executor, results = FakeExecutor(size=1), list[int]()

    def at(here: str, key: int) -> int:
        if place == here and key == 2:
            raise error
        return key

    def keep(key: int, _result: int) -> None:
        results.append(at("on_result", key))

    with pytest.raises(error):
        run_campaign(range(9), lambda key: at("work", key), executor, on_result=keep)
    assert results == [0, 1]
    assert executor.ended


def test_while_no_result_arrives_it_reports_and_passes_messages_on() -> None:
    waits: list[None] = []
    messages: list[str] = []
    executor, go = FakeExecutor(size=1), threading.Event()
    executor.messages = ["a worker is silent"]

    def on_wait() -> None:
        waits.append(None)
        if len(waits) == 2:
            go.set()

    run_campaign(
        [1],
        lambda _key: go.wait(20.0),
        executor,
        on_result=lambda _key, result: messages.append(f"result {result}"),
        on_message=messages.append,
        on_wait=on_wait,
    )
    assert messages == ["a worker is silent", "result True"]
    assert len(waits) == 2


def test_the_process_that_hands_out_trials_does_without_the_robot() -> None:
    """The workers import it; one after the other they would begin later."""
    code = """
import sys
import lab.demonstrations.collect.progress, lab.studies.latency.run, lab.trials.results
print({"services.wbc.service", "pinocchio", "osqp"} & set(sys.modules) or "none")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "none\n"
