"""The rig of the fault experiments: options, verdicts, results and exit codes."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from pydantic import Field

from verification.faults.__main__ import PLANS, main
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row


class Toy(FaultPlan):
    name = "toy"
    setup = fault = recovery = "none"
    promises = (
        Promise("all are small", "size [m]", 2.0),
        Promise("red ones are tiny", "size [m]", 1.0, {"colour": "red"}),
    )
    quick: ClassVar = {"sizes": (1.0,)}

    sizes: tuple[float, ...] = Field(default=(1.0, 2.0), description="sizes [m]")

    def measure(self, progress: Progress) -> Iterator[Row]:
        progress("measuring")
        for size in self.sizes:
            yield {"colour": "red" if size < 2.0 else "blue", "size [m]": size}


class Failing(Toy):
    name = "failing"

    def measure(self, progress: Progress) -> Iterator[Row]:
        raise FaultError("no root")


def run(tmp_path: Path, *argv: str) -> int:
    return main([*argv, "--out", str(tmp_path)], (Toy, Failing))


def test_kept_promises_exit_with_0_and_leave_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "toy") == 0
    content = json.loads((tmp_path / "toy.json").read_text())
    assert [row["size [m]"] for row in content["rows"]] == [1.0, 2.0]
    assert [(v["measured"], v["kept"]) for v in content["verdicts"]] == [(2.0, True), (1.0, True)]
    printed = capsys.readouterr().out
    assert "size [m]" in printed
    assert "BROKEN" not in printed


def test_a_broken_promise_exits_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, "toy", "--sizes", "1.5", "2.5") == 1
    verdicts = json.loads((tmp_path / "toy.json").read_text())["verdicts"]
    assert [(v["measured"], v["kept"]) for v in verdicts] == [(2.5, False), (1.5, False)]
    assert capsys.readouterr().out.count("BROKEN") == 2


def test_a_promise_that_was_not_measured_is_broken(tmp_path: Path) -> None:
    assert run(tmp_path, "toy", "--sizes", "2.0") == 1


def test_an_experiment_that_cannot_run_is_reported_and_the_others_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "failing", "toy") == 1
    assert "no root" in capsys.readouterr().out
    assert (tmp_path / "toy.json").exists()


def test_quick_values_give_way_to_options(tmp_path: Path) -> None:
    def sizes(*argv: str) -> list[float]:
        run(tmp_path, "toy", *argv)
        return list(json.loads((tmp_path / "toy.json").read_text())["options"]["sizes"])

    assert sizes("--quick") == [1.0]
    assert sizes("--quick", "--sizes", "0.5", "1") == [0.5, 1.0]


@pytest.mark.parametrize("argv", [("unknown",), ("toy", "--sizes", "big"), ("--colour", "red")])
def test_wrong_options_exit_with_2(tmp_path: Path, argv: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as stopped:
        run(tmp_path, *argv)
    assert stopped.value.code == 2


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.name)
def test_defaults_and_quick_values_are_valid(plan: type[FaultPlan]) -> None:
    assert plan() != plan.model_validate(plan.quick)
    assert plan.promises
