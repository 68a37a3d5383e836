"""Options, environment and file reach the bus, the links and the service."""

import os
from pathlib import Path

import pytest

from common.errors import ConfigError
from common.links.config import Links
from common.links.spec import Distribution
from common.runtime.live.main import argument_parser, load_settings, run_live
from common.runtime.live.realtime import enter_realtime
from tests.common.runtime.toys import add_arguments, build

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
        ("[links]\n'wcb:estop' = '5ms'", "no service 'wcb'"),
        ("[wcb]\nrate = 200", r"no table \[wcb\]"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "stack.toml"
    path.write_text(text)
    arguments = argument_parser("wbc").parse_args(["--config", str(path)])
    with pytest.raises(ConfigError, match=complaint):
        load_settings(arguments, "wbc", {})


@pytest.mark.parametrize("where", ["option", "variable"])
def test_wrong_links_are_named(where: str) -> None:
    text = "teleop/setpoint=abc"
    arguments = argument_parser("wbc").parse_args(["--link", text] if where == "option" else [])
    environment = {"TRILL_LINKS": text} if where == "variable" else {}
    with pytest.raises(ConfigError, match="'teleop/setpoint' is wrong: 'abc' is not a duration"):
        load_settings(arguments, "wbc", environment)


def test_a_service_outside_the_port_table_has_its_own_table_and_links(tmp_path: Path) -> None:
    path = tmp_path / "stack.toml"
    path.write_text("[links]\n'odd:estop' = '5ms'\n[odd]\nkind = 'own'\n")
    arguments = argument_parser("odd").parse_args(["--config", str(path)])
    _, links, _, settings = load_settings(arguments, "odd", {})
    assert settings == {"kind": "own"}
    assert str(links.of("odd", "estop")) == "5ms"


def test_a_service_in_the_background_takes_real_time_from_its_option_only() -> None:
    environment = {"TRILL_RT_PRIORITY": "30"}
    parser = argument_parser("logger", background=True)
    assert load_settings(parser.parse_args([]), "logger", environment)[2].rt_priority == 0
    chosen = parser.parse_args(["--rt-priority", "5"])
    assert load_settings(chosen, "logger", environment)[2].rt_priority == 5


def test_a_service_whose_inputs_cannot_be_delayed_has_no_such_option() -> None:
    parser = argument_parser("logger", delayable=False)
    assert "--link" not in parser.format_help()
    assert load_settings(parser.parse_args([]), "logger", {})[1] == Links()


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
    for default in ("draco3", "127.0.0.1", "7448", "default: 20"):
        assert default in text
    assert "None" not in text


def test_help_shows_the_defaults_that_say_something() -> None:
    parser = argument_parser("wbc")
    parser.add_argument("--seed", default=0, help="a number")
    parser.add_argument("--pace", default="", help="a name")
    parser.add_argument("--raw", action="store_true", help="a flag")
    text = " ".join(parser.format_help().split())
    assert "a number (default: 0)" in text
    assert "a name (" not in text
    assert "a flag (" not in text


def test_no_realtime_is_asked_for_with_priority_0() -> None:
    before = os.sched_getscheduler(0)
    assert enter_realtime(0) == "normal"
    assert os.sched_getscheduler(0) == before


def test_refused_realtime_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert enter_realtime(20) == "normal (SCHED_FIFO 20 not permitted)"
