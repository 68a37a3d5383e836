"""``trill collect`` as a process: cut off in every way, resumed; and its errors and tables."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from lab.cli.main import main
from lab.demonstrations.collect.episode import make_episode
from lab.demonstrations.collect.store import DatasetStore
from tests.lab.demonstrations.collect.support import CONFIG, fake_executor, gather

ROOT = Path(__file__).resolve().parents[4]
LONG = 240.0
"""A trial takes a few seconds; a busy machine many more [s]."""


def command(out: Path, *more: str) -> list[str]:
    options = ["--no-images", "--physics-steps", "5", "--episodes", "2", "--out", str(out)]
    return [sys.executable, "-m", "lab.cli", "collect", "door/unlock", *options, *more]


def begun(out: Path, log: Path) -> "subprocess.Popen[bytes]":
    """A run with two workers, in a process group of its own."""
    with log.open("wb") as file:
        return subprocess.Popen(
            command(out, "--jobs", "2"), cwd=ROOT, stderr=file, start_new_session=True
        )


def children(pid: int) -> list[int]:
    return [int(text) for text in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False


def until(what: str, true: Callable[[], object]) -> None:
    end = time.monotonic() + LONG
    while not true():
        assert time.monotonic() < end, f"not within {LONG:g} s: {what}"
        time.sleep(0.05)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_ended_killed_and_resumed_it_comes_to_the_same_bytes(tmp_path: Path) -> None:
    out = tmp_path / "cut"

    process = begun(out, tmp_path / "ended.txt")
    # Python's resource tracker and two workers.
    until("workers", lambda: len(children(process.pid)) >= 3)
    workers = children(process.pid)
    # As a service manager does, and timeout: the command, and its whole group.
    process.terminate()
    os.killpg(process.pid, signal.SIGTERM)
    assert process.wait(LONG) == 130
    said = (tmp_path / "ended.txt").read_text()
    assert "Traceback" not in said
    assert "leaked" not in said
    assert "died" not in said
    assert "the same command continues it" in said
    until("no orphan", lambda: not any(map(alive, workers)))

    process = begun(out, tmp_path / "killed.txt")
    until("a first episode", lambda: process.poll() is not None or DatasetStore(out).files())
    workers = children(process.pid)
    process.kill()
    assert process.wait(LONG) == -signal.SIGKILL
    until("no orphan", lambda: not any(map(alive, workers)))
    assert 1 <= len(DatasetStore(out).files()) <= 2

    resumed = subprocess.run(
        command(out, "--jobs", "2"), cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "of these from before" in resumed.stderr
    store = DatasetStore(out)
    lines = store.scan()
    assert lines == store.index()
    assert len(lines) >= 2
    for line in lines:
        undisturbed = make_episode(CONFIG, line.meta.seed)
        assert line.meta == undisturbed.meta
        assert not line.kept or (out / line.file).read_bytes() == undisturbed.content
    assert {path.name for path in out.iterdir()} == {
        *("dataset.json", "index.jsonl", "episodes", "rejected", ".lock")
    }


def test_the_command_line_is_there_without_what_collecting_needs() -> None:
    code = (
        "import sys\n"
        "for name in ('mujoco', 'h5py', 'pinocchio', 'cv2', 'ray'): sys.modules[name] = None\n"
        "import argparse, lab.cli.collect as c\n"
        "parser = argparse.ArgumentParser(); c.add_arguments(parser)\n"
        "from common.errors import ConfigError\n"
        "try: c.run(parser.parse_args(['door/unlock']))\n"
        "except ConfigError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "'.[collect]'" in done.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "expected a task"),
        (["door/unlock", "--info", "x"], "expected a task"),
        (["door/unlock", "--width", "3"], "pictures.width"),
        (["door/unlock", "--link", "nowhere=250ms"], "nowhere"),
        (["door/unlock", "--sheet", "a.png"], "--info"),
        (["--info", "x", "--episode", "3"], "give both"),
    ],
)
def test_wrong_options_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if "--info" in options else ["--out", str(tmp_path / "d")]
    assert main(["collect", *options, *out]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--seed", "-1", "expected a number from 0 up, got '-1'"),
        ("--jobs", "0", "expected a number from 1 up, got '0'"),
        ("--traits", "drunk", "practised"),
        ("--pace", "sprint", "public"),
        ("--physics-steps", "11", "invalid choice"),
    ],
)
def test_wrong_values_are_refused(
    option: str, value: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["collect", "door/unlock", option, value])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert option in said
    assert words in said


def test_an_unknown_task_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["collect", "door/lock", "--out", str(tmp_path / "d")]) == 2
    assert "door/unlock" in capsys.readouterr().err


def test_info_and_reindex(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gather(tmp_path, 3, fake_executor(failing={1, 2}))
    (tmp_path / "index.jsonl").unlink()
    assert main(["collect", "--info", str(tmp_path)]) == 1
    assert "--reindex" in capsys.readouterr().err
    assert main(["collect", "--reindex", str(tmp_path)]) == 0
    assert "5 trials" in capsys.readouterr().out
    assert main(["collect", "--info", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "3 (60 %)" in shown
    assert "2 x failure: failure it was" in shown
    assert main(["collect", "--info", str(tmp_path), "--sheet", str(tmp_path / "s.png")]) == 1
    assert "without pictures" in capsys.readouterr().err
    assert main(["collect", "--reindex", str(tmp_path / "none")]) == 1
    assert "no data set" in capsys.readouterr().err


def test_a_name_that_is_none_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / ("x" * 300)
    assert main(["collect", "door/unlock", "--no-images", "--out", str(out)]) == 1
    assert "name too long" in capsys.readouterr().err


def test_where_no_data_set_is_none_is_to_be_indexed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["collect", "--info", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert "no data set in" in said
    assert "--reindex" not in said
