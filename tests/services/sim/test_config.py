"""Configuration, and the command line over it."""

from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigError
from common.plant.config import GuardConfig, TorqueMode
from common.runtime.live.main import argument_parser
from common.tables import validated
from services.sim import __main__ as cli
from services.sim.config import TYPICAL_NOISE, SimConfig


@pytest.mark.parametrize(
    "settings",
    [
        {"state_rate": 300},
        {"com_height": 0.9},
        {"com_height": float("nan")},
        {"unknown": 1},
        {"guard": {"hold_after": 2.0, "damp_after": 1.0}},
        {"noise": {"position": -1.0}},
        {"physics_steps": 5, "catch_up_steps": 4},
        {"torque_mode": "infinite"},
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="SimConfig is wrong"):
        validated(SimConfig, settings)


def test_rated_stands_taller_unless_told() -> None:
    assert SimConfig().standing_com_height == 0.70
    assert SimConfig(torque_mode=TorqueMode.RATED).standing_com_height == 0.73
    assert SimConfig(torque_mode=TorqueMode.RATED, com_height=0.65).standing_com_height == 0.65


def parse(settings: dict[str, Any], *argv: str) -> SimConfig:
    parser = argument_parser("sim", cli.DESCRIPTION)
    cli._add_arguments(parser)
    arguments = parser.parse_args(argv)
    arguments.settings = settings
    return cli.build(arguments).plant.config


def test_options_lie_over_the_file_which_lies_over_the_defaults() -> None:
    table = {"torque_mode": "rated", "seed": 3, "state_rate": 500}
    config = parse(table, "--seed", "4", "--noise", "typical")
    assert config.torque_mode is TorqueMode.RATED
    assert config.seed == 4
    assert config.state_rate == 500
    assert config.noise == TYPICAL_NOISE
    assert parse({"noise": {"position": 0.01}}, "--noise", "none").noise.position == 0.0
    assert parse({}) == SimConfig()


def test_the_file_of_stops_is_the_launchers_unless_the_configuration_names_one(
    tmp_path: Path,
) -> None:
    given = ("--latch-file", str(tmp_path / "a.json"))
    assert parse({}).guard.latch_file == ""
    assert parse({"guard": {"damp_after": 4.0}}, *given).guard == GuardConfig(
        damp_after=4.0, latch_file=given[1]
    )
    own = str(tmp_path / "b.json")
    assert parse({"guard": {"latch_file": own}}, *given).guard.latch_file == own


def test_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argument_parser("sim", cli.DESCRIPTION)
    cli._add_arguments(parser)
    text = " ".join(parser.format_help().split())
    for word in ("python -m services.sim", "--torque-mode", "200 N·m", "holds its posture", "flat"):
        assert word in text
