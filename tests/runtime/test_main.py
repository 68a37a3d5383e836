"""Options, environment and file reach the bus, the links and the service."""

import os
from pathlib import Path

import pytest

from common.bus.linkspec import Distribution
from common.errors import ConfigError
from common.runtime.main import argument_parser, load_settings, run_live
from common.runtime.realtime import enter_realtime
from tests.runtime.toys import add_arguments, build

FILE = """
[bus]
robot = "file"
lease_ms = 800
[links]
"plant/state" = "5ms"
"wbc:estop" = "1ms"
[runtime]
rt_priority = 0
seed = 3
[wbc]
kind = "careful"
[sim]
kind = "other"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "stack.toml"
    path.write_text(FILE)
    return path


def test_file_serves_the_whole_stack(file: Path) -> None:
    arguments = argument_parser("wbc").parse_args(["--config", str(file)])
    bus, links, runtime, settings = load_settings(arguments, "wbc", {})
    assert (bus.robot, bus.lease_ms, bus.base_port) == ("file", 800, 7448)
    assert str(links.of("logger", "plant/state")) == "5ms"
    assert str(links.of("wbc", "estop")) == "1ms"
    assert links.of("sim", "estop") is None
    assert (runtime.rt_priority, runtime.seed) == (0, 3)
    assert settings == {"kind": "careful"}


def test_environment_and_arguments_override(file: Path) -> None:
    environment = {
        "TRILL_CONFIG": str(file),
        "TRILL_ROBOT": "env",
        "TRILL_BASE_PORT": "9000",
        "TRILL_LINKS": "plant/state=7ms; camera/left=normal(122ms, 190ms) loss=1%",
        "TRILL_RT_PRIORITY": "30",
    }
    argv = ["--robot", "arg", "--link", "plant/state=9ms", "--connect", "tcp/a:1,tcp/b:2"]
    arguments = argument_parser("wbc").parse_args(argv)
    bus, links, runtime, _ = load_settings(arguments, "wbc", environment)
    assert (bus.robot, bus.base_port, bus.lease_ms) == ("arg", 9000, 800)
    assert bus.connect == ("tcp/a:1", "tcp/b:2")
    assert str(links.of("wbc", "plant/state")) == "9ms"
    camera = links.of("wbc", "camera/left")
    assert camera is not None
    assert camera.distribution is Distribution.NORMAL
    assert runtime.rt_priority == 30
    arguments = argument_parser("wbc").parse_args(["--rt-priority", "0"])
    assert load_settings(arguments, "wbc", environment)[2].rt_priority == 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("robot = 'x'", "outside of any"),
        ("[bus]\nspeed = 3", "speed"),
        ("[runtime]\nrt_priority = 200", "rt_priority"),
        ("[links]\nnowhere = '5ms'", "nowhere"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "stack.toml"
    path.write_text(text)
    arguments = argument_parser("wbc").parse_args(["--config", str(path)])
    with pytest.raises(ConfigError, match=complaint):
        load_settings(arguments, "wbc", {})


def test_wrong_configuration_exits_with_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(os.environ):
        if name.startswith("TRILL_"):
            monkeypatch.delenv(name)
    code = run_live(build, "sim", ["--robot", "two words"], add_arguments=add_arguments)
    assert code == 2
    assert "robot" in capsys.readouterr().err


def test_help_names_every_variable(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        argument_parser("wbc", "the controller").parse_args(["--help"])
    text = capsys.readouterr().out
    for name in ("CONFIG", "ROBOT", "MODE", "HOST", "BASE_PORT", "CONNECT", "LISTEN", "LINKS"):
        assert f"TRILL_{name}" in text


def test_no_realtime_is_asked_for_with_priority_0() -> None:
    before = os.sched_getscheduler(0)
    assert enter_realtime(0) == "normal"
    assert os.sched_getscheduler(0) == before


def test_refused_realtime_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert enter_realtime(20) == "normal (SCHED_FIFO 20 not permitted)"
