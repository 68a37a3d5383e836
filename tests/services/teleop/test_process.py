"""The scripted operator under the runners, and its command line."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import OperatorClaim
from common.topics import TELEOP_CLAIM
from services.teleop.__main__ import main
from services.teleop.scripted.script import Script, Wait
from services.teleop.scripted.service import ScriptedConfig, ScriptedOperator

ROOT = Path(__file__).parents[3]


def run(*options: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "services.teleop", *options],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_a_failed_script_ends_its_process_with_the_reason(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = min(int(probe.getsockname()[1]), 60000)
    config = tmp_path / "trill.toml"
    config.write_text("[teleop]\nstart_timeout = 0.3\nlinger = 0.1\n")
    options = ["--config", str(config), "--base-port", str(port), "--rt-priority", "0"]
    result = run("scripted", *options)
    assert result.returncode == 1
    expected = "the controller did not balance within 0.3 s; last seen: no controller state"
    assert expected in result.stderr


def test_in_simulated_time_an_ended_operator_is_silent() -> None:
    operator = ScriptedOperator(
        Script(name="t", steps=(Wait(seconds=1.0),)), ScriptedConfig(start_timeout=0.5, linger=0.5)
    )
    claims: list[OperatorClaim] = []
    with SimTimeRunner([operator]) as runner:
        runner.on_message(TELEOP_CLAIM, claims.append)
        runner.run_for(5.0)
    assert operator.exit_code == 1
    # Waiting fails at the first tick past 0.5 s, then 0.5 s more, and the release.
    assert 10 <= len(claims) <= 12
    assert [claim.wants for claim in claims[-2:]] == [True, False]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["scripted", "--script", "fly"], "expected demo, stand, gaits, random or a .json file"),
        (["scripted", "--script", "missing.json"], "cannot read the script missing.json"),
        (["scripted", "--gait", "hop"], "invalid choice: 'hop'"),
        (["scripted", "--count", "0"], "expected at least 1, got 0"),
        (["scripted", "--script", "stand", "--seconds", "-1"], "expected more than 0"),
        (["fly"], "expected scripted, keyboard, headset or synthetic, got 'fly'"),
    ],
)
def test_wrong_options_are_explained(options: list[str], message: str) -> None:
    result = run(*options)
    assert result.returncode == 2
    assert message in result.stderr


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--help"], "scripted   plays a script"),
        (["scripted", "--help"], "--script random --count 20 --seed 3"),
        (["keyboard", "--help"], "x/Bksp/Del EMERGENCY STOP"),
    ],
)
def test_help_teaches(options: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(options)
    except SystemExit as leaving:
        code = int(leaving.code or 0)
    assert code == 0
    assert text in capsys.readouterr().out


def test_the_example_in_the_help_is_a_script(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["scripted", "--help"])
    out = capsys.readouterr().out
    start = out.index('{"name"')
    script = Script.model_validate_json(out[start : out.rindex("}") + 1])
    assert [step.do for step in script.steps] == ["move", "sine", "together", "wait", "mark"]
