"""A robot that MuJoCo and pinocchio would read differently is refused, by name."""

from pathlib import Path

import pytest

from common.robot import joints
from services.wbc.errors import ModelError
from services.wbc.mjcf_subset import check_mjcf
from services.wbc.robot_model import RobotModel

NECK = '<body name="neck_pitch_link" pos="-0.0025 0 0.352">'
CASES = {
    "degrees": ('angle="radian"', 'angle="degree"', "degree"),
    "compiler option": ("<compiler ", '<compiler coordinate="local" ', "coordinate"),
    "gravity": ("<worldbody>", '<option gravity="0 0 -1.6"/><worldbody>', "option"),
    "include": ("<worldbody>", '<include file="hand.xml"/><worldbody>', "include"),
    "second tree": (
        "</worldbody>",
        '<body name="box"><freejoint/></body></worldbody>',
        "'box'",
    ),
    "fixed base": ('<freejoint name="base"/>', "", "freejoint"),
    "unnamed body": (NECK, NECK.replace('name="neck_pitch_link" ', ""), "without a name"),
    "euler angles": (NECK, NECK.replace("pos=", 'euler="0 0.1 0" pos='), "'euler'"),
    "frame": (NECK, '<frame pos="0 0 0.1"/>' + NECK, "<frame>"),
    "joint reference": ('name="neck_pitch" axis', 'name="neck_pitch" ref="0.1" axis', "'ref'"),
    "default reference": ('type="hinge" armature', 'ref="0.1" type="hinge" armature', "'ref'"),
    "principal inertia": (
        'mass="6.41443" fullinertia', 'mass="6.41443" diaginertia', "'diaginertia'",
    ),
}  # fmt: skip


def _edited(case: str, folder: Path) -> tuple[Path, str]:
    old, new, token = CASES[case]
    text = joints.MJCF_PATH.read_text(encoding="utf-8")
    assert old in text
    path = folder / "robot.xml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path, token


def test_the_robot_is_within_the_subset() -> None:
    check_mjcf(joints.MJCF_PATH)


@pytest.mark.parametrize("case", CASES)
def test_what_the_libraries_read_differently_is_refused(case: str, tmp_path: Path) -> None:
    path, token = _edited(case, tmp_path)
    with pytest.raises(ModelError, match=token):
        check_mjcf(path)


def test_the_controller_checks_its_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, _ = _edited("degrees", tmp_path)
    monkeypatch.setattr(joints, "MJCF_PATH", path)
    with pytest.raises(ModelError, match="degree"):
        RobotModel()
