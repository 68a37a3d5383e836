"""Verdicts on the run of a script, and how a run starts and ends."""

import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.schemas import GuardMode, OperatorStatus
from deploy import launch
from deploy.errors import DeployError
from deploy.launch import Verdict, running_system
from deploy.process import Exit, ProcessSpec, tail
from deploy.system import SystemOptions, new_run_dir, robot_processes
from lab.live.demo import FALL_AFTERMATH, ScriptJudge
from lab.monitor.bus_stats import Snapshot
from tests.lab.review.synthetic import FakeRobot

NOTHING: list[Exit] = []


def ended(name: str, code: int = 1, **changes: Any) -> Exit:
    values: dict[str, Any] = {"expected": False, "restarted": False, "tail": ("last words",)}
    return Exit(name, code, **(values | changes))


def view(*, fallen: bool = False, failed: str = "", heard: bool = True) -> Snapshot:
    robot = FakeRobot()
    operator = OperatorStatus(
        script="demo", step=3, steps=9, label="walk", finished=bool(failed), failed=failed
    )
    _, plant = robot.status(fallen=fallen)
    _, control = robot.wbc()
    return Snapshot((), (), control if heard else None, plant, operator)  # type: ignore[arg-type]


def judge(seconds: float | None = None) -> ScriptJudge:
    return ScriptJudge("teleop", seconds, timeout=100.0)


def test_the_operators_good_end_completes_the_run() -> None:
    exits = [ended("teleop", 0, expected=True)]
    assert judge().verdict(50.0, view(), NOTHING) is None
    assert judge().verdict(50.0, view(), exits) == Verdict("completed")


def test_the_operators_failure_gives_its_reason() -> None:
    verdict = judge().verdict(50.0, view(failed="hand out of reach"), [ended("teleop")])
    assert verdict == Verdict("script failed", "hand out of reach")
    silent = judge().verdict(5.0, Snapshot((), ()), [ended("teleop", 2)])
    assert silent is not None
    assert "exit code 2" in silent.reason
    assert "last words" in silent.reason


def test_a_death_is_named_but_not_that_of_a_dispensable_process() -> None:
    verdict = judge().verdict(5.0, view(), [ended("cameras", essential=False), ended("wbc", -11)])
    assert verdict is not None
    assert verdict.outcome == "service died"
    assert "wbc ended: killed by SIGSEGV" in verdict.reason
    assert judge().verdict(5.0, view(), [ended("cameras", essential=False)]) is None
    assert judge().verdict(5.0, view(), [ended("wbc", restarted=True)]) is None


def test_a_fall_outweighs_what_follows_from_it_and_is_watched_a_while() -> None:
    one = judge()
    assert one.verdict(10.0, view(fallen=True), NOTHING) is None
    assert one.verdict(10.1, view(fallen=True), [ended("teleop")]) is None
    verdict = one.verdict(10.0 + FALL_AFTERMATH, view(fallen=True), NOTHING)
    assert verdict is not None
    assert verdict.outcome == "fell"
    assert "step 3 of 9" in verdict.reason


def test_a_fall_after_an_emergency_stop_names_who_stopped_the_robot() -> None:
    one, seen = judge(), view(fallen=True)
    assert seen.plant is not None
    stop = {"guard": GuardMode.ESTOP, "stopped_by": "keyboard"}
    seen = replace(seen, plant=seen.plant.model_copy(update=stop))
    assert one.verdict(10.0, seen, NOTHING) is None
    verdict = one.verdict(10.0 + FALL_AFTERMATH, seen, NOTHING)
    assert verdict is not None
    assert "STOPPED by keyboard" in verdict.reason


def test_time_runs_out_and_asked_for_seconds_count_from_the_controllers_first_word() -> None:
    late = judge().verdict(100.0, view(), NOTHING)
    assert late is not None
    assert late.outcome == "timed out"
    short = judge(seconds=5.0)
    assert short.verdict(20.0, view(heard=False), NOTHING) is None
    assert short.verdict(21.0, view(), NOTHING) is None
    stopped = short.verdict(26.0, view(), NOTHING)
    assert stopped is not None
    assert stopped.outcome == "completed"


def test_the_process_list_follows_the_options() -> None:
    specs = {s.name: s for s in robot_processes(SystemOptions(torque_mode="rated"), Path("r"))}
    assert list(specs) == ["router", "logger", "sim", "cameras", "wbc"]
    assert specs["wbc"].args == ("--torque-mode", "rated")
    latch = ("--latch-file", "r/estop.json")
    assert specs["sim"].args == ("--torque-mode", "rated", *latch)
    task = robot_processes(SystemOptions(task="door/unlock", seed=7), Path("r"))
    (plant,) = (spec.args for spec in task if spec.name == "sim")
    assert plant == ("--seed", "7", "--task", "door/unlock", *latch)
    # A configuration file decides what no option says.
    bare = robot_processes(SystemOptions(), Path("r"))
    assert [spec.args for spec in bare[2:]] == [latch, (), ()]
    assert specs["logger"].args == ("--out", "r")
    assert not specs["cameras"].essential
    assert not specs["router"].essential
    assert specs["sim"].stop_order < specs["wbc"].stop_order < specs["logger"].stop_order
    bare = robot_processes(SystemOptions(cameras=False, record=False), Path("r"))
    assert [s.name for s in bare if s.enabled] == ["router", "sim", "wbc"]


def test_run_directories_never_collide(tmp_path: Path) -> None:
    made = [new_run_dir(tmp_path / "runs") for _ in range(3)]
    assert len(set(made)) == 3
    (tmp_path / "file").write_text("")
    with pytest.raises(DeployError, match=r"file is in the way|cannot make"):
        new_run_dir(tmp_path / "file")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_leaves_the_context_quietly_and_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    (tmp_path / "fake_service.py").write_text(
        "import os, sys, time\nprint(os.environ['TRILL_BASE_PORT'], flush=True)\ntime.sleep(60)\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{':'.join(sys.path)}")
    monkeypatch.chdir(tmp_path)
    fakes = [ProcessSpec("a", "fake_service"), ProcessSpec("b", "fake_service", stop_order=1)]
    monkeypatch.setattr(launch, "robot_processes", lambda _options, _run_dir: fakes)
    with running_system(SystemOptions(), None) as running:
        supervisor = running.supervisor
        while not all(tail(supervisor.log_path(spec.name)) for spec in fakes):
            time.sleep(0.02)
        assert tail(supervisor.log_path("a")) == (str(running.bus.base_port),)
        os.kill(os.getpid(), number)
        time.sleep(30)
        pytest.fail("the signal did not end the context")
    assert supervisor.running() == []
    assert running.run_dir.is_dir()
