"""A policy as the operator of a trial, with and without sight, and its baselines."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra policy")

from common.schemas import CameraFrame, Setpoint
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, TELEOP_SETPOINT, Topic
from lab.errors import LabError
from lab.learning.evaluation.mean_pictures import mean_pictures
from lab.learning.evaluation.plan import blind, constant
from lab.review.frames import decode_frame
from lab.trials.operators.kinds import operator_code
from lab.trials.operators.specs import StillPictures, SyntheticSpec
from lab.trials.results import run_trial, trial_code
from lab.trials.spec import TrialSpec
from lab.trials.stack import TaskStack
from services.policy.checkpoint.manifest import describe
from services.sim.errors import RenderingUnavailableError
from services.sim.tasks import find_task
from tests.lab.demonstrations.export.support import make, picture
from tests.lab.learning.evaluation.support import checkpoint, operator_of, trial


@pytest.fixture(autouse=True)
def soon_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of 2 s: the robot is given away after half a second of balance."""
    monkeypatch.setattr(
        "services.sim.physics.plant.find_task", lambda name: replace(find_task(name), limit=2.0)
    )


def sent(spec: TrialSpec, *topics: Topic[Any]) -> tuple[TaskStack, list[Any]]:
    """Run a trial; returns what was published on ``topics``."""
    stack = TaskStack(spec)
    messages: list[Any] = []
    for topic in topics:
        stack.runner.on_message(topic, messages.append)
    stack.run()
    return stack, messages


def test_a_policy_operates_the_robot_and_its_trial_repeats(tmp_path: Path) -> None:
    spec = trial(operator_of(checkpoint(tmp_path / "made")))
    stack, setpoints = sent(spec, TELEOP_SETPOINT)
    assert {setpoint.header.source for setpoint in setpoints} == {"policy"}
    assert len(setpoints) > 20
    assert stack.operator.failure == ""
    first, again = (run_trial({"policy": trial_code(spec.operator)}, spec) for _ in range(2))
    assert first.verdict == "failure"
    assert first.reason.startswith("not within 2 s")
    assert first.model_copy(update={"wall": 0.0}) == again.model_copy(update={"wall": 0.0})


def test_another_checkpoint_in_the_same_place_is_refused(tmp_path: Path) -> None:
    operator = operator_of(checkpoint(tmp_path / "made")).model_copy(update={"digest": "0" * 64})
    with pytest.raises(LabError, match="another checkpoint than this trial's"):
        TaskStack(trial(operator))


def test_where_a_checkpoint_lies_and_its_label_do_not_count(tmp_path: Path) -> None:
    operator = operator_of(checkpoint(tmp_path / "made"))
    still = StillPictures(file="a.png", sha256="1")
    spec = trial(operator.model_copy(update={"pictures": still}))
    moved = {"checkpoint": "there", "label": "mine", "pictures": still.model_copy(
        update={"file": "b.png"})}  # fmt: skip
    assert trial(spec.operator.model_copy(update=moved)).key == spec.key  # type: ignore[arg-type]
    others: tuple[dict[str, Any], ...] = (
        {"digest": "0"},
        {"constant": True},
        {"serving": {}},
        {"pictures": still.model_copy(update={"sha256": "2"})},
    )
    for changed in others:
        other = spec.operator.model_copy(update=changed)
        assert trial(other).key != spec.key  # type: ignore[arg-type]


def test_code_of_policies_does_not_count_for_the_synthetic_operator(tmp_path: Path) -> None:
    policy = operator_of(checkpoint(tmp_path / "made"))
    root = "lab.trials.stack"
    assert operator_code(policy, root).source != operator_code(SyntheticSpec(), root).source
    assert "torch" in operator_code(policy, root).versions
    assert "torch" not in operator_code(SyntheticSpec(), root).versions


def test_the_constant_baseline_holds_the_mean_action(tmp_path: Path) -> None:
    folder = checkpoint(tmp_path / "made")
    _, setpoints = sent(trial(constant(operator_of(folder))), TELEOP_SETPOINT)
    mean = np.array(describe(folder).processor.action.mean)[:3]
    last: Setpoint = setpoints[-1]
    assert last.left_hand_position_in_body == pytest.approx(mean, abs=1e-6)
    assert last.gripper_closure.tolist() == [0.0, 0.0]


def test_the_blind_baseline_sees_the_mean_pictures_of_a_data_set(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", ("success", "success"))
    pictures = mean_pictures(dataset, tmp_path / "new" / "mean.png")
    operator = blind(operator_of(checkpoint(tmp_path / "made", "stereo")), pictures)
    _, frames = sent(trial(operator), CAMERA_LEFT, CAMERA_RIGHT)
    assert len(frames) > 50
    for eye in ("left", "right"):
        shown = {frame.data for frame in frames if frame.eye == eye}
        assert len(shown) == 1
        # Every tenth frame of the 13 of an episode.
        mean = np.mean([picture(s, eye, f) for s in (0, 1) for f in (0, 10)], axis=0)
        frame: CameraFrame = next(frame for frame in frames if frame.eye == eye)
        image = cv2.resize(decode_frame(frame), (48, 32), interpolation=cv2.INTER_AREA)
        assert np.abs(image.astype(float) - mean).mean() < 6.0
    (tmp_path / "new" / "mean.png").write_bytes(b"another")
    with pytest.raises(LabError, match="another file than this trial's"):
        TaskStack(trial(operator))


def test_a_policy_sees_pictures_of_the_size_it_learned_from(tmp_path: Path) -> None:
    spec = trial(operator_of(checkpoint(tmp_path / "made", "stereo")))
    try:
        stack, frames = sent(spec, CAMERA_LEFT, CAMERA_RIGHT)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert {(frame.width, frame.height) for frame in frames} == {(64, 48)}
    assert {frame.eye for frame in frames} == {"left", "right"}
    assert stack.operator.note == "acting"
