"""``trill dataset export`` on the command line: what it makes, says and refuses."""

import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from lab.cli.main import main
from lab.demonstrations.export.lerobot import is_lerobot
from lab.demonstrations.export.robomimic import is_robomimic
from tests.lab.demonstrations.export.support import VERDICT, make

ROOT = Path(__file__).resolve().parents[4]


def export(*options: object) -> int:
    return main(["dataset", "export", *map(str, options)])


def test_both_formats_beside_the_data_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = make(tmp_path / "door")
    assert export(root, "--format", "lerobot") == 0
    said = capsys.readouterr().out
    assert is_lerobot(tmp_path / "door-lerobot")
    assert f"3 episodes of door/unlock: {3 * VERDICT} frames, pictures 48x32" in said
    assert "by synthetic operator" in said
    assert said.splitlines()[-1] == str(tmp_path / "door-lerobot")
    assert export(root, "--format", "robomimic", "--seeds", "1:", "--tail") == 0
    out = tmp_path / "door-robomimic.hdf5"
    assert is_robomimic(out)
    with h5py.File(out) as file:
        assert file["data/demo_0"].attrs["seed"] == 1
    assert export(root, "--format", "robomimic") == 1
    assert "--force" in capsys.readouterr().err
    assert export(root, "--format", "robomimic", "--force", "--pictures", "none") == 0
    with h5py.File(out) as file:
        assert len(file["data"]) == 3
        assert "robot0_left_camera_image" not in file["data/demo_0/obs"]


def test_force_replaces_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = make(tmp_path / "door", ("success",), size=None)
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter").write_text("1")
    for form in ("lerobot", "robomimic"):
        assert export(root, "--format", form, "--out", precious, "--force") == 1
        assert "not replaced" in capsys.readouterr().err
    assert (precious / "chapter").read_text() == "1"


def test_force_replaces_nobody_elses_data_in_the_same_format(tmp_path: Path) -> None:
    root = make(tmp_path / "door", ("success",), size=None)
    recorded = tmp_path / "recorded"
    (recorded / "meta").mkdir(parents=True)
    about = recorded / "meta" / "info.json"
    demos = tmp_path / "demos.hdf5"
    with h5py.File(demos, "w") as file:
        file.create_group("data").attrs["total"] = 7
    before = demos.read_bytes()
    for text in ('{"codebase_version": "v3.0", "robot_type": "arm"}', "3"):
        about.write_text(text)
        assert export(root, "--format", "lerobot", "--out", recorded, "--force") == 1
        assert about.read_text() == text
    assert export(root, "--format", "robomimic", "--out", demos, "--force") == 1
    assert demos.read_bytes() == before


@pytest.mark.parametrize("name", ["a {x} %d", "a:b", "tür auf"])
def test_any_name_will_do(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    root = make(Path(name), ("success",))
    for form in ("lerobot", "robomimic"):
        assert export(root, "--format", form, "--out", f"{name}.{form}") == 0
    assert len(list((tmp_path / f"{name}.lerobot").rglob("file-000.mp4"))) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--format", "lerobot", "--compress"], "--compress"),
        (["--format", "lerobot", "--no-scale-actions"], "--scale-actions"),
        (["--format", "lerobot", "--next-obs"], "--next-obs"),
        (["--format", "lerobot", "--state", "hands,elbows"], "--state"),
        (["--format", "robomimic", "--crf", "20"], "--crf"),
        (["--format", "lerobot", "--crf", "20", "--pictures", "embedded"], "--crf"),
        (["--format", "robomimic", "--pictures", "video"], "no video"),
        (["--format", "lerobot", "--pictures", "none", "--width", "64"], "--width"),
        (["other", "--format", "lerobot"], "--out"),
    ],
)
def test_wrong_options_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(tmp_path, *options) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("seeds", ["3", "a:b", "1:2:3"])
def test_wrong_seeds_are_refused(seeds: str, tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        export(tmp_path, "--format", "lerobot", "--seeds", seeds)


def test_the_missing_extra_is_named() -> None:
    code = (
        "import sys\n"
        "for name in ('av', 'pyarrow', 'h5py', 'cv2', 'mujoco'): sys.modules[name] = None\n"
        "from lab.cli.main import main\n"
        "sys.modules['cv2'] = sys.modules['h5py'] = sys\n"
        "raise SystemExit(main(['dataset', 'export', 'x', '--format', 'lerobot']))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "'.[lerobot]'" in done.stderr
