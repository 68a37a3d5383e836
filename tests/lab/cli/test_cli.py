"""The command line: help, options, error messages, make targets and the set-up script."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lab.cli.main import COMMANDS, main
from lab.cli.policy_task import say_other_task
from lab.live import drive
from lab.review import report
from services.policy.checkpoint.manifest import MANIFEST, PROCESSOR
from tests.lab.review.test_report import recorded
from tests.services.policy.made import small
from tests.services.policy.served import description_of

ROOT = Path(__file__).parents[3]


def test_every_command_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    overview = capsys.readouterr().out
    for command in COMMANDS:
        assert command.name in overview
        with pytest.raises(SystemExit) as ended:
            main([command.name, "--help"])
        assert ended.value.code == 0
        text = capsys.readouterr().out
        assert "examples:" in text
        assert f"trill {command.name}" in text.partition("examples:")[2]


def test_the_version_says_whether_compiled_code_is_in_use(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRILL_NATIVE", "0")
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert "no compiled kernels (TRILL_NATIVE=0)" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [[], ["fly"], ["demo", "--torque-mode", "heroic"], ["top", "--base-port", "x"], ["report"]],
)
def test_wrong_options_exit_with_2(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2


def test_wrong_values_are_explained(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["top", "--config", "missing.toml"]) == 2
    assert "missing.toml" in capsys.readouterr().err
    assert main(["report", "nowhere"]) == 1
    assert "cannot open the log nowhere" in capsys.readouterr().err


def test_every_command_takes_a_directory_or_any_file_for_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "draw_pictures", lambda _log, _timeline, video: "")
    recorded(tmp_path)
    (tmp_path / "log.mcap").rename(tmp_path / "saved.mcap")
    saved = str(tmp_path / "saved.mcap")
    for command in (["info"], ["report"], ["replay", "--list"], ["repair"]):
        assert main([*command, saved]) in {0, 2}
        assert "annot open" not in capsys.readouterr().err
        # Its directory is not that of a run.
        assert main([*command, str(tmp_path)]) in {1, 2}
        assert "got saved.mcap" in capsys.readouterr().err
    assert (tmp_path / "saved-summary.json").exists()
    assert not (tmp_path / "summary.json").exists()


def test_drive_without_a_terminal_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drive, "terminal", lambda: False)
    assert main(["drive"]) == 1
    assert "drive needs a terminal" in capsys.readouterr().err


def test_a_log_alone_does_not_say_that_the_run_was_completed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(tmp_path)
    monkeypatch.setattr(report, "draw_pictures", lambda _log, _timeline, video: "")
    assert main(["report", str(tmp_path / "log.mcap")]) == 0
    assert "outcome        unknown" in capsys.readouterr().out
    assert json.loads((tmp_path / "summary.json").read_text())["outcome"] == "unknown"


@pytest.mark.parametrize("text", ["", "hello"])
def test_garbage_is_not_summed_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "log.mcap").write_text(text)
    assert main(["report", str(tmp_path)]) == 1
    assert "not an MCAP log" in capsys.readouterr().err
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["demo", "--script", "nope"], "expected demo, stand, gaits, random or a .json file"),
        (["demo", "--script", "nope.json"], "cannot read the script nope.json"),
        (["demo", "--base-port", "3"], "base_port"),
        (["up", "--config", "wrong.toml"], "no table [wcb]"),
        (["record", "--base-port", "3"], "base_port"),
    ],
)
def test_wrong_options_start_nothing_and_leave_no_run(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrong.toml").write_text("[wcb]\n")
    assert main(words) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_make_help_lists_every_target() -> None:
    ended = subprocess.run(
        ["make", "-s", "-C", str(ROOT), "help"], capture_output=True, text=True, check=True
    )
    for target in ("demo", "drive", "top", "test", "suite", "bench", "lint"):
        assert f"  {target} " in ended.stdout


def test_setup_names_what_is_missing(tmp_path: Path) -> None:
    for tool in ("dirname", "cat", "uname", "id"):
        where = subprocess.run(["which", tool], capture_output=True, text=True, check=True)
        (tmp_path / tool).symlink_to(where.stdout.strip())
    ended = subprocess.run(
        ["/bin/sh", str(ROOT / "deploy/setup.sh"), str(tmp_path / "venv")],
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 1
    assert "no Python 3.11 or 3.12 found" in ended.stderr
    assert "apt-get install python3.11" in ended.stderr


def test_the_command_runs_from_anywhere(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "lab.cli", "top", "--help"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "--ledger" in ended.stdout


def test_a_viewers_machine_needs_neither_physics_nor_solvers() -> None:
    code = (
        "import sys, lab.cli.main; "
        "print(sorted({'mujoco', 'pinocchio', 'osqp', 'daqp', 'rerun'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "command",
    [
        ["tasks"],
        ["demo", "--task", "door/unlock"],
        ["up", "--task", "door/unlock"],
        ["collect", "door/unlock"],
        ["study", "latency"],
        ["dataset", "export", ".", "--format", "robomimic"],
    ],
    ids=" ".join,
)
def test_what_a_command_lacks_is_named(command: list[str]) -> None:
    program = (
        "import sys\n"
        "sys.modules |= dict.fromkeys(('mujoco', 'pinocchio', 'h5py', 'matplotlib', 'av'))\n"
        "from lab.cli.main import main\n"
        f"sys.exit(main({command!r}))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.returncode in {1, 2}
    assert "pip install '.[" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_policy_of_another_task_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    say_other_task(Path("best"), "door/walk", "door/unlock")
    assert capsys.readouterr().err == "note: best has learned door/walk; it is given door/unlock\n"
    say_other_task(Path("best"), "door/walk", "door/walk")
    say_other_task(Path("best"), "", "door/walk")
    say_other_task(Path("best"), "door/walk", None)
    assert not capsys.readouterr().err


def test_a_policy_that_cannot_be_run_is_refused_before_anything_starts(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["up", "--remote"]) == 2
    assert "give --policy too" in capsys.readouterr().err
    assert main(["up", "--policy", "nowhere"]) == 1
    assert "cannot read config.json of the checkpoint nowhere" in capsys.readouterr().err
    seeing = tmp_path / "seeing"
    seeing.mkdir()
    description = description_of(small("trill"))
    (seeing / MANIFEST).write_text(description.manifest.model_dump_json())
    (seeing / PROCESSOR).write_text(description.processor.model_dump_json(indent=1))
    assert main(["up", "--policy", "seeing", "--no-cameras"]) == 2
    assert "sees through the left and right camera" in capsys.readouterr().err
    assert main(["up", "--policy", "seeing", "--runtime", "onnx"]) == 1
    assert "seeing has no exported network" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
