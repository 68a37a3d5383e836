"""What the launcher refuses before it starts anything."""

from pathlib import Path

import pytest

from common.errors import ConfigError
from deploy.launch import running_system
from deploy.system import SystemOptions, check_torque_limits


@pytest.mark.parametrize(
    "text",
    [
        '[sim]\ntorque_mode = "rated"',
        '[wbc]\ntorque_mode = "rated"',
        '[wbc.limits]\ntorque_mode = "rated"',
        '[sim]\ntorque_mode = "rated"\n[wbc]\ntorque_mode = "rated"\n'
        '[wbc.limits]\ntorque_mode = "relaxed"',
    ],
)
def test_plant_and_controller_with_other_torque_limits_are_not_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    path = tmp_path / "system.toml"
    path.write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="--torque-mode"):
        running_system(SystemOptions(config=path), None).__enter__()
    assert not (tmp_path / "runs").exists()
    monkeypatch.setenv("TRILL_CONFIG", str(path))
    with pytest.raises(ConfigError, match="--torque-mode"):
        check_torque_limits(SystemOptions())
    check_torque_limits(SystemOptions(torque_mode="rated"))


def test_the_same_limits_are_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRILL_CONFIG", raising=False)
    check_torque_limits(SystemOptions())
    path = tmp_path / "system.toml"
    for text in (
        "",
        '[sim]\ntorque_mode = "rated"\n[wbc]\ntorque_mode = "rated"',
        '[sim]\ntorque_mode = "rated"\n[wbc.limits]\ntorque_mode = "rated"',
    ):
        path.write_text(text)
        check_torque_limits(SystemOptions(config=path))
