"""Trainers that take turns: what they say is judged round by round, and they do train."""

import json
import sys
from pathlib import Path

import pytest

from benchmarks.bench_training import OWN, Trainer, Turn, measure, ratio, table, work_of
from benchmarks.rounds import WorkloadError

SLOW = (Turn(2.0, 1.0, 9.0), Turn(4.0, 2.0, 8.0), Turn(9.0, 3.0, 7.0))
FAST = (Turn(1.0, 0.5, 9.0), Turn(1.0, 0.5, 8.0), Turn(3.0, 1.0, 7.0))
FAKE = """
from benchmarks.workloads.turns import own_stdout, take_turns
out = own_stdout()
print("a library says something")
take_turns(out, {{"name": "{0}", "parameters": {1}}}, lambda count: float(count))
"""


def fake(name: str, parameters: int) -> list[str]:
    return [sys.executable, "-c", FAKE.format(name, parameters)]


def test_a_ratio_is_the_median_of_the_rounds_own_ratios() -> None:
    assert ratio(FAST, SLOW, "cpu") == (3.0, 2.0, 4.0)
    assert ratio(FAST, SLOW, "wall") == (3.0, 2.0, 4.0)
    line = table({"ours": list(FAST), "peer": list(SLOW)}, 10, "peer")[1]
    shown = "ours 20 (10-20) 10 (3.33-10) 3 (2-4) 3 (2-4) 7.00"
    assert " ".join(line.split()) == shown


def test_processes_take_turns_and_the_first_ones_do_not_count(tmp_path: Path) -> None:
    turns = measure([fake("a", 100), fake("b", 101)], tmp_path, rounds=2, steps=3)
    assert {name: [turn.loss for turn in found] for name, found in turns.items()} == {
        "a": [3.0, 3.0],
        "b": [3.0, 3.0],
    }


def test_networks_of_other_sizes_are_not_compared(tmp_path: Path) -> None:
    with pytest.raises(WorkloadError, match=r"same size, got \{'a': 100, 'b': 103\}"):
        measure([fake("a", 100), fake("b", 103)], tmp_path, rounds=1, steps=1)


def test_a_process_that_cannot_train_says_why(tmp_path: Path) -> None:
    with pytest.raises(WorkloadError, match="No module named 'no_peer'"):
        measure([[sys.executable, "-c", "import no_peer"]], tmp_path, rounds=1, steps=1)


def test_our_own_learns(tmp_path: Path) -> None:
    work = work_of((16, 16), batch=2, window=2)
    file = tmp_path / "work.json"
    file.write_text(json.dumps(work | {"frames": 2, "episodes": 1}))
    with Trainer([sys.executable, *OWN, str(file), "float32"], tmp_path) as trainer:
        assert trainer.name == "trill, float32"
        assert trainer.turn(1).loss > trainer.turn(8).loss
