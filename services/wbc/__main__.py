"""``python -m services.wbc``: the whole-body controller as a process."""

import argparse
import sys

from common.runtime.main import run_live
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
    settings = dict(getattr(arguments, "settings", {}) or {})
    config = wbc_config(arguments.torque_mode, arguments.pace)
    config = config.model_copy(
        update={
            "rate": arguments.rate,
            "solver": arguments.solver,
            "qp_dump_dir": arguments.qp_dump,
            "hands": config.hands.model_copy(
                update={"mode": "raw" if arguments.raw_hands else config.hands.mode}
            ),
        }
    )
    if settings:
        config = WbcConfig.model_validate(_merged(config.model_dump(), settings))
    return WbcService(config)


def _merged(base: dict[str, object], over: dict[str, object]) -> dict[str, object]:
    """``base`` with the nested tables of ``over`` laid over it."""
    result = dict(base)
    for key, value in over.items():
        known = result.get(key)
        if isinstance(known, dict) and isinstance(value, dict):
            result[key] = _merged(known, value)
        else:
            result[key] = value
    return result


def main() -> int:
    """Run the controller until a signal."""
    return run_live(
        _build, "wbc", sys.argv[1:], add_arguments=_add_arguments, description=DESCRIPTION
    )


if __name__ == "__main__":
    raise SystemExit(main())
