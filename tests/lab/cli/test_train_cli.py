"""``trill train``: its options, and what it says when they are wrong."""

import json
from pathlib import Path

import pytest

from lab.cli.main import main
from tests.lab.learning.training.support import dataset

pytest.importorskip("torch", reason="needs the extra policy")


def said(capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str, str]:
    code = main(["train", *options])
    out, error = capsys.readouterr()
    return code, out, error


def test_settings_are_shown_and_set(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--recipe", "paper", "--inputs", "blind", "--steps", "7")
    sets = ("--set", "policy.inputs.joint_state=false", "--set", "training.precision=float32")
    code, out, _ = said(capsys, "door/unlock", *options, *sets, "--show")
    found = json.loads(out)
    assert code == 0
    assert found["training"]["steps"] == 7
    assert found["training"]["precision"] == "float32"
    assert found["policy"]["inputs"]["joint_state"] is False


def test_it_trains_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, out = dataset(tmp_path / "data", 3), tmp_path / "out"
    options = ("--data", str(data), "--out", str(out), "--inputs", "scene", "--steps", "2")
    for _ in range(2):
        code, printed, error = said(capsys, "door/unlock", *options)
        assert code == 0, error
        assert f"{out}: 2 steps" in printed
    assert (out / "last" / "config.json").is_file()
    assert (out / "curves.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("door/unlok",), "unknown task 'door/unlok'"),
        (("door/unlock", "--scene", "hammer"), "got 'hammer'; it has leaf.x"),
        (("door/unlock", "--set", "rate=1"), "expected --set policy.KEY=VALUE"),
        (("door/unlock", "--set", "training.rate=-1"), "training"),
        (("door/unlock", "--data", "/nowhere"), "no data set in /nowhere"),
        (("door/unlock", "--device", "cuda:99"), "torch cannot use --device cuda:99"),
        (("door/unlock", "--minutes", "0"), "minutes"),
    ],
)
def test_what_is_wrong_is_said(
    options: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, error = said(capsys, *options)
    assert code in {1, 2}
    assert words in error
