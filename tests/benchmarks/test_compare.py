"""Two builds run in turn, each with its own sources, and the verdict is the exit code."""

import json
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from benchmarks import compare, rounds
from benchmarks.builds import OWN_ROOT, Build
from benchmarks.comparison import Bound, Row
from benchmarks.rounds import SCRIPTS, Run, Workload, check_tree, results_in_turn
from common.errors import ConfigError

ROW = Row("time", "speed", "toy.speed", more=True, must=Bound(1.7))


def script(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def tree(root: Path, speed: float) -> Path:
    (root / "common").mkdir(parents=True)
    (root / "pyproject.toml").write_text("")
    (root / "common" / "__init__.py").write_text(f"SPEED = {speed}\n")
    return root


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workload that prints what its build's ``common`` says, and two builds to run it on."""
    script(
        tmp_path / "toy.py",
        "import json, common\nprint('a word before')\nprint(json.dumps({'speed': common.SPEED}))",
    )
    monkeypatch.setattr(rounds, "SCRIPTS", tmp_path)
    monkeypatch.setattr(rounds, "WORKLOADS", {"toy": Workload("toy.py")})
    monkeypatch.setattr(compare, "ROWS", (ROW,))
    tree(tmp_path / "old", 4.0)
    tree(tmp_path / "new", 8.0)
    return tmp_path


def test_the_exit_code_is_the_verdict(toy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = toy / "found.json"
    old, new = str(toy / "old"), str(toy / "new")
    assert compare.main([old, new, "--rows", "time", "--rounds", "2", "--json", str(file)]) == 0
    assert "2.00 ×  2.00–2.00  ≥ 1.7 ×       kept" in capsys.readouterr().out
    found = json.loads(file.read_text())
    assert found["rounds"] == {"old": [{"toy.speed": 4.0}] * 2, "new": [{"toy.speed": 8.0}] * 2}
    assert found["rows"][0]["ratio"] == 2.0
    assert compare.main([new, old, "--rows", "time", "--rounds", "1"]) == 1
    assert "missed" in capsys.readouterr().out


def test_a_workload_that_fails_is_said_and_counts_as_missed(
    toy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (toy / "new" / "common" / "__init__.py").write_text("")
    arguments = [str(toy / "old"), str(toy / "new"), "--rows", "time", "--rounds", "1"]
    assert compare.main(arguments) == 1
    told = capsys.readouterr()
    assert "not measured" in told.out
    assert "toy, new, failed" in told.err
    assert "has no attribute 'SPEED'" in told.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "expected a source tree with a pyproject.toml"),
        ([".", "--rows", "time,speed"], "no row speed; expected some of time, pictures"),
        ([".", "--rounds", "0"], "expected 1 or more, got 0"),
        ([".", "--json", "no/file.json"], "expected a file in a folder that exists"),
        ([".", "--placo-python", "no/python"], "expected an interpreter, got no/python"),
    ],
)
def test_wrong_arguments_are_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        compare.main(arguments)
    assert ended.value.code == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_tree_whose_packages_are_not_imported_is_refused(tmp_path: Path) -> None:
    check_tree(Build("own", tree(tmp_path / "own", 1.0)))
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="expected the packages of"):
        check_tree(Build("empty", tmp_path / "empty"))


def test_a_tree_whose_kernels_are_not_built_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TRILL_NATIVE", raising=False)
    own = tree(tmp_path / "own", 1.0)
    shutil.copy(OWN_ROOT / "common" / "native.py", own / "common")
    check_tree(Build("own", own))
    (own / "common" / "_fast.c").write_text("")
    with pytest.raises(ConfigError, match=r"but common\._fast is not built"):
        check_tree(Build("own", own))
    monkeypatch.setenv("TRILL_NATIVE", "0")
    check_tree(Build("own", own))


def test_processes_take_turns_one_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rounds, "TURN_S", 0.02)
    worker = script(
        tmp_path / "worker.py",
        "import json, time\n"
        "seen = set()\n"
        "while time.process_time() < 0.2:\n"
        "    seen.add(round(time.monotonic(), 3))\n"
        "open('seen.json', 'w').write(json.dumps(sorted(seen)))\n"
        "print(json.dumps({'ended': time.monotonic()}))\n",
    )
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
    runs = [Run([sys.executable, str(worker)], {}, folder) for folder in folders]
    assert all(isinstance(result, dict) for result in results_in_turn(runs))
    one, two = (json.loads((folder / "seen.json").read_text()) for folder in folders)
    stamps = sorted([(t, 1) for t in one] + [(t, 2) for t in two])
    changes = sum(before[1] != after[1] for before, after in pairwise(stamps))
    # A signal takes a moment, so a turn may begin before the other's last millisecond is over.
    # Side by side the two would take turns every millisecond or so.
    assert 2 <= changes <= 2 + 3 * (stamps[-1][0] - stamps[0][0]) / rounds.TURN_S


def test_round_trips_end_together_with_their_echo_processes() -> None:
    # An echo that lived on would hold the pipe open, and the run would not end.
    command = [sys.executable, "-P", str(SCRIPTS / "round_trips.py"), "50"]
    environment = Build("ours", OWN_ROOT).environment
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=60.0, check=True
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert found.keys() == {"typed_us", "zenoh_us", "tcp_us"}
    assert found["tcp_us"] < found["zenoh_us"]
