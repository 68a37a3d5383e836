"""The whole chain in closed loop: demonstrations, training, evaluation; and the shipped policy."""

from pathlib import Path

import pytest

from lab.cli.main import main
from lab.trials.results import JsonLines, TrialRecord
from services.sim.errors import RenderingUnavailableError
from services.sim.rendering.cameras import CameraConfig, StereoRenderer

pytest.importorskip("torch", reason="needs the extra policy")

SHIPPED = Path(__file__).parents[3] / "policies" / "door-unlock"


def verdicts(checkpoint: Path, seeds: str, out: Path) -> list[str]:
    """Evaluate with the command; return the verdict of each trial."""
    assert main(["eval", str(checkpoint), "--seeds", seeds, "--jobs", "2", "--out", str(out)]) == 0
    return [record.result.verdict for record in JsonLines(out, TrialRecord).read()]


def test_a_policy_that_is_told_the_scene_learns_the_task(tmp_path: Path) -> None:
    """Thirty demonstrations and twenty seconds of training: it opens unseen doors."""
    data, out = tmp_path / "data", tmp_path / "policy"
    made = ["--episodes", "30", "--seed", "1000", "--jobs", "2", "--physics-steps", "5"]
    told = ["--inputs", "scene", "--steps", "400"]
    assert main(["collect", "door/unlock", *made, "--no-images", "--out", str(data)]) == 0
    assert main(["train", "door/unlock", "--data", str(data), "--out", str(out), *told]) == 0
    found = verdicts(out / "last", "0:6", tmp_path / "trials.jsonl")
    assert len(found) == 6
    assert found.count("success") >= 5, found


def test_the_shipped_policy_does_its_task_from_pictures(tmp_path: Path) -> None:
    try:
        StereoRenderer(CameraConfig()).close()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert verdicts(SHIPPED, "0:3", tmp_path / "trials.jsonl") == ["success"] * 3
