"""``python -m services.wbc``: the whole-body controller as a process."""

import argparse
import sys

from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.packages import imports_of
from common.runtime.live.main import run_live
from common.tables import overlaid
from common.topics import TELEOP_SETPOINT

with imports_of("services.wbc", "wbc"):
    from services.wbc.config import PACES, WbcConfig, wbc_config
    from services.wbc.service import WbcService

DESCRIPTION = """Run the whole-body controller: measured state, hand set-points and gait requests
in, joint commands out. It takes the robot over in any posture, stands it up, and then walks one
gait at a time on request. When set-points become stale, the hands hold."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add options without defaults, so that only given ones override the file's table."""
    group = parser.add_argument_group("control", argument_default=argparse.SUPPRESS)
    group.add_argument(
        "--torque-mode",
        choices=["relaxed", "rated"],
        help="torque limits of the QP: relaxed adds 200 N·m to the legs, as the public TRILL "
        "simulation does; rated keeps those of the URDF, with which the robot stands taller and "
        "walks more slowly (default: relaxed)",
    )
    group.add_argument(
        "--pace",
        choices=list(PACES),
        help="time a gait takes: fast 2.2 s, normal 3.35 s, slow 3.95 s, public 6.1 s as in the "
        "public TRILL code (normal; slow if rated)",
    )
    group.add_argument("--rate", type=float, help="ticks per second (100); 200 if the CPU allows")
    group.add_argument(
        "--solver",
        choices=["osqp", "daqp", "quadprog"],
        help="solver of the QPs that cannot be solved faster: daqp (default, exact), osqp, or "
        "quadprog, which the wbc extra does not install",
    )
    group.add_argument(
        "--raw-hands", action="store_true", help="jump to each hand set-point, no interpolation"
    )
    group.add_argument("--qp-dump", metavar="DIR", help="directory for unsolved QPs")


def _build(arguments: argparse.Namespace) -> WbcService:
    """Build the service: the file's ``[wbc]`` table overrides presets, and options override both.

    The table may also select the presets by ``torque_mode`` and ``pace``.
    """
    given, table = vars(arguments), dict(arguments.settings)
    preset = {name: table.pop(name, "") for name in ("torque_mode", "pace")}
    preset |= {name: given[name] for name in preset if name in given}
    chosen: dict[str, object] = {
        field: given[option]
        for option, field in (("rate", "rate"), ("solver", "solver"), ("qp_dump", "qp_dump_dir"))
        if option in given
    }
    hands = {}
    if TELEOP_SETPOINT.name in arguments.max_age:
        hands["stale_after"] = arguments.max_age[TELEOP_SETPOINT.name]
    table = overlaid({"hands": hands}, table)
    if "raw_hands" in given:
        chosen["hands"] = {"mode": "raw"}
    if "torque_mode" in given:
        chosen["limits"] = {"torque_mode": given["torque_mode"]}
    try:
        base = wbc_config(preset["torque_mode"] or "relaxed", preset["pace"]).model_dump()
        return WbcService(WbcConfig.model_validate(overlaid(overlaid(base, table), chosen)))
    except ValidationError as error:
        raise ConfigError(f"the controller's configuration is wrong: {explain(error)}") from error
    except ValueError as error:
        raise ConfigError(f"the controller's configuration is wrong: {error}") from error


def main() -> int:
    """Run the controller until a signal."""
    return run_live(
        _build, "wbc", sys.argv[1:], add_arguments=_add_arguments, description=DESCRIPTION
    )


if __name__ == "__main__":
    raise SystemExit(main())
