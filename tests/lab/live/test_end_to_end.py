"""The demonstration itself, as a person starts it, with a script of one gait."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lab.review.run_summary import RunSummary

ROOT = Path(__file__).parents[3]
SCRIPT = {
    "name": "one gait",
    "steps": [
        {"do": "mark", "label": "grip"},
        {"do": "grip", "left": 1.0, "right": 1.0},
        {"do": "mark", "label": "walk"},
        {"do": "gait", "gait": "forward", "count": 1},
    ],
}


def demo(folder: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "lab.cli", "demo", "--headless", "--no-cameras", *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=180,
    )


def left_behind(folder: Path) -> list[str]:
    """Processes whose working directory is ``folder``."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").resolve() == folder.resolve():
                found.append((process / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


def test_one_gait_from_start_to_summary(tmp_path: Path) -> None:
    (tmp_path / "script.json").write_text(json.dumps(SCRIPT))
    ended = demo(tmp_path, "--script", "script.json", "--no-pictures")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (run_dir,) = (tmp_path / "runs").iterdir()
    summary = RunSummary.model_validate_json((run_dir / "summary.json").read_text())
    assert summary.outcome == "completed"
    (gait,) = summary.gait_runs
    assert (gait.gait, gait.outcome) == ("forward", "completed")
    assert gait.forward == pytest.approx(0.2, abs=0.03)
    assert abs(gait.turn_deg) < 3.0
    assert summary.plant.falls == 0
    assert summary.plant.commands_applied > 300
    assert {"sim", "wbc", "teleop"} <= set(summary.services)
    assert not summary.log_truncated
    command = summary.topics["wbc/command"]
    assert command.messages > 300
    assert (command.dropped, command.undecodable) == (0, 0)
    logs = {path.name for path in (run_dir / "logs").iterdir()}
    assert logs == {"router.txt", "logger.txt", "sim.txt", "wbc.txt", "teleop.txt"}
    assert left_behind(tmp_path) == []


def test_a_task_is_done_and_its_verdict_is_the_exit_code(tmp_path: Path) -> None:
    ended = demo(tmp_path, "--task", "door/unlock", "--seed", "7", "--no-pictures")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (run_dir,) = (tmp_path / "runs").iterdir()
    summary = RunSummary.model_validate_json((run_dir / "summary.json").read_text())
    assert summary.outcome == "completed"
    (trial,) = summary.trials
    assert (trial.task, trial.seed, trial.verdict) == ("door/unlock", 7, "success")
    assert None not in [stage.at for stage in trial.stages]
    assert "door/unlock seed 7 by synthetic door/unlock: SUCCESS" in ended.stdout

    short = demo(tmp_path, "--task", "door/unlock", "--seconds", "1", "--no-pictures")
    assert short.returncode == 1
    assert "stopped after 1 s; no verdict at" in short.stderr
    wrong = demo(tmp_path, "--task", "door/unlok")
    assert wrong.returncode == 2
    assert "--task: unknown task 'door/unlok': expected one of" in wrong.stderr
    assert left_behind(tmp_path) == []


def test_a_script_that_does_not_exist_starts_nothing(tmp_path: Path) -> None:
    ended = demo(tmp_path, "--script", "nonsense")
    assert ended.returncode == 2
    assert "nonsense" in ended.stderr
    assert "random" in ended.stderr
    assert not (tmp_path / "runs").exists()
    assert left_behind(tmp_path) == []
