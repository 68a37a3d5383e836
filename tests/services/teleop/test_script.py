from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from common.errors import ConfigError
from common.robot.kinematics import FORWARD_HAND
from common.robot.workspace import clamp_to_workspace
from common.schemas import Gait
from services.teleop.scripted.library import SCRIPTS, ScriptOptions
from services.teleop.scripted.script import (
    HandPose,
    Move,
    Script,
    Sine,
    Step,
    Together,
    Walk,
    load_script,
    parts_used,
)
from services.teleop.targets.hand import hand_quaternion


def flat(steps: tuple[Step, ...]) -> list[Step]:
    result: list[Step] = []
    for step in steps:
        result += (
            flat(tuple(s for lane in step.lanes for s in lane))
            if isinstance(step, Together)
            else [step]
        )
    return result


def test_demo_walks_every_gait_once_or_twice_and_moves_everything() -> None:
    steps = flat(SCRIPTS["demo"](ScriptOptions()).steps)
    walked: dict[Gait, int] = {gait: 0 for gait in Gait if gait is not Gait.NONE}
    for step in steps:
        if isinstance(step, Walk):
            walked[step.gait] += step.count
    assert set(walked.values()) <= {1, 2}
    used = {part for step in steps for part in parts_used(step)}
    assert used == {"left hand", "right hand", "left gripper", "right gripper", "neck", "legs"}


def test_random_script_is_decided_by_its_seed() -> None:
    first, again = (SCRIPTS["random"](ScriptOptions(seed=7, count=12)) for _ in range(2))
    other = SCRIPTS["random"](ScriptOptions(seed=8, count=12))
    assert first == again
    assert first != other
    gaits = [step.gait for step in flat(first.steps) if isinstance(step, Walk)]
    assert len(gaits) == 12
    assert len(set(gaits)) >= 3


def test_gaits_script_repeats_the_gait_asked_for() -> None:
    script = SCRIPTS["gaits"](ScriptOptions(gait=Gait.SIDE_LEFT, count=4))
    gaits = [step.gait for step in flat(script.steps) if isinstance(step, Walk)]
    assert gaits == [Gait.SIDE_LEFT] * 4


@pytest.mark.parametrize("name", list(SCRIPTS))
def test_every_hand_pose_is_inside_the_workspace(name: str) -> None:
    for step in flat(SCRIPTS[name](ScriptOptions(count=50)).steps):
        if isinstance(step, Move):
            for side, pose in (("left", step.left), ("right", step.right)):
                if pose is not None:
                    p = np.array(pose.position)
                    np.testing.assert_array_equal(p, clamp_to_workspace(side, p))


@pytest.mark.parametrize("name", list(SCRIPTS))
def test_built_in_scripts_survive_a_file(name: str, tmp_path: Path) -> None:
    script = SCRIPTS[name](ScriptOptions())
    path = tmp_path / "script.json"
    path.write_text(script.model_dump_json())
    assert load_script(path) == script


def test_gaits_are_written_by_name(tmp_path: Path) -> None:
    path = tmp_path / "script.json"
    path.write_text('{"name": "x", "steps": [{"do": "gait", "gait": "turn_left", "count": 2}]}')
    assert load_script(path).steps == (Walk(gait=Gait.TURN_LEFT, count=2),)
    path.write_text('{"name": "x", "steps": [{"do": "gait", "gait": "hop"}]}')
    with pytest.raises(
        ConfigError, match=r"steps\.0\.gait\.gait: expected one of forward, backward, side_left"
    ):
        load_script(path)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.json: No such file"):
        load_script(tmp_path / "nothing.json")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Walk(gait=Gait.NONE), "got none"),
        (lambda: Move(duration=1.0), "left or the right hand"),
        (lambda: Sine(hand="left", axis="x", amplitude=0.1, frequency=1.0), "0.628"),
        (lambda: HandPose(position=(float("nan"), 0.0, 0.0)), "finite"),
        (lambda: Script.model_validate({"name": "x", "steps": [{"do": "jump"}]}), "jump"),
    ],
)
def test_wrong_steps_are_refused(build: object, message: str) -> None:
    assert callable(build)
    with pytest.raises(ValidationError, match=message):
        build()


def test_lanes_may_not_share_a_hand_or_the_legs() -> None:
    left = Move(left=HandPose(position=(0.3, 0.2, 0.0)))
    right = Move(right=HandPose(position=(0.3, -0.2, 0.0)))
    Together(lanes=((left,), (right,), (Walk(gait=Gait.FORWARD),)))
    with pytest.raises(ValidationError, match="two lanes use the same left hand"):
        Together(lanes=((left,), (Together(lanes=((left,), (right,))),)))
    with pytest.raises(ValidationError, match="legs"):
        Together(lanes=((Walk(gait=Gait.FORWARD),), (Walk(gait=Gait.BACKWARD),)))


def test_rotation_none_keeps_the_orientation_and_mirroring_is_its_own_inverse() -> None:
    assert HandPose(position=(0.3, 0.2, 0.0), rotation=None).quaternion() is None
    pose = HandPose(position=(0.3, 0.2, 0.1), rotation=(0.1, 0.2, 0.3))
    assert pose.mirrored().mirrored() == pose
    quaternion = pose.mirrored().quaternion()
    assert quaternion is not None
    np.testing.assert_allclose(quaternion, hand_quaternion(-0.1, 0.2, -0.3))
    level = HandPose(position=(0.3, 0.2, 0.1)).quaternion()
    assert level is not None
    np.testing.assert_allclose(level, FORWARD_HAND)
