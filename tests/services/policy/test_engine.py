"""The engine that computes in the policy's process: when the network runs, and when it answers."""

import numpy as np
import pytest

from services.policy.processor.processor import Decision
from services.policy.serving.engine import LocalEngine, Memory, Request

REQUEST = Request(
    7, np.zeros((1, 3), np.float32), np.zeros((1, 0, 1, 1, 3), np.uint8), np.zeros(2, np.float32)
)


class Counting:
    """A runtime that counts its runs."""

    def __init__(self) -> None:
        self.runs = 0

    def run(self, *_: object) -> tuple[Decision, Memory]:
        self.runs += 1
        return Decision(*(np.zeros(1, np.float32),) * 3), np.ones(2, np.float32)


def test_without_delay_an_answer_is_there_at_once() -> None:
    engine = LocalEngine(runtime := Counting())
    engine.ask(REQUEST)
    assert runtime.runs == 1
    (answer,) = engine.answers()
    assert answer.step == 7
    assert answer.memory.tolist() == [1.0, 1.0]
    engine.work()
    assert engine.answers() == []
    assert not engine.waiting


@pytest.mark.parametrize("steps", [1, 3])
def test_with_delay_the_network_runs_once_the_set_point_is_sent(steps: int) -> None:
    engine = LocalEngine(runtime := Counting(), steps)
    engine.ask(REQUEST)
    assert runtime.runs == 0
    for _ in range(steps):
        assert engine.waiting
        assert engine.answers() == []
        engine.work()
        assert runtime.runs == 1
    assert [answer.step for answer in engine.answers()] == [7]
    assert not engine.waiting


def test_a_newer_request_takes_the_place_of_an_older_one() -> None:
    engine = LocalEngine(runtime := Counting(), 2)
    engine.ask(REQUEST)
    engine.work()
    engine.ask(REQUEST._replace(step=8))
    engine.work()
    assert engine.answers() == []
    engine.work()
    assert [answer.step for answer in engine.answers()] == [8]
    assert runtime.runs == 2
