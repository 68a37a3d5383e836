"""``python -m services.wbc``: the whole-body controller as a process."""

import argparse
import sys

from pydantic import ValidationError

from common.errors import ConfigError
from common.runtime.main import run_live
from common.tables import overlaid
from services.wbc.config import PACES, WbcConfig, wbc_config
from services.wbc.service import WbcService

DESCRIPTION = """Whole-body controller: measured state, hand set-points and gait requests in,
joint commands out. Takes the robot over in whatever posture it finds it, stands it up, then walks
one gait at a time on request. Stale set-points: the hands hold."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("control")
    group.add_argument(
        "--torque-mode",
        choices=["relaxed", "rated"],
        default="relaxed",
        help="torque limits the QP assumes; rated also stands taller and walks slower",
    )
    group.add_argument("--pace", choices=sorted(PACES), default="", help="how long a gait takes")
    group.add_argument(
        "--rate", type=float, default=100.0, help="control rate [Hz]; 200 if the CPU allows"
    )
    group.add_argument("--solver", choices=["osqp", "daqp", "quadprog"], default="osqp")
    group.add_argument(
        "--raw-hands", action="store_true", help="jump to each hand set-point, no interpolation"
    )
    group.add_argument("--qp-dump", default="", metavar="DIR", help="keep unsolved QPs here")


def _build(arguments: argparse.Namespace) -> WbcService:
    """The service from its options, with the ``[wbc]`` table of the configuration file on top."""
    chosen: dict[str, object] = {
        "rate": arguments.rate,
        "solver": arguments.solver,
        "qp_dump_dir": arguments.qp_dump,
    }
    if arguments.raw_hands:
        chosen["hands"] = {"mode": "raw"}
    base = wbc_config(arguments.torque_mode, arguments.pace).model_dump()
    try:
        return WbcService(
            WbcConfig.model_validate(overlaid(overlaid(base, chosen), arguments.settings))
        )
    except ValidationError as error:
        raise ConfigError(f"the controller's configuration is wrong: {error}") from error


def main() -> int:
    """Run the controller until a signal."""
    return run_live(
        _build, "wbc", sys.argv[1:], add_arguments=_add_arguments, description=DESCRIPTION
    )


if __name__ == "__main__":
    raise SystemExit(main())
