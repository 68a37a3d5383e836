"""``python -m services.policy.server``: computes a policy's answers, on any host.

It keeps nothing between two requests, since the recurrent state travels with each. So it may be
killed, started again, moved to another host or run twice.
"""

import argparse
import logging
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

from common.program import run_program
from common.runtime.live.main import OptionFormatter
from common.tables import validated
from common.transport.config import BusConfig, bus_of
from common.transport.options import add_bus_options
from common.transport.session import open_session
from services.policy.checkpoint.manifest import Description
from services.policy.options import add_runtime_options
from services.policy.runtimes.load import load_runtime
from services.policy.serving.config import PolicyConfig
from services.policy.serving.engine import Runtime
from services.policy.serving.inference import InferenceServer

NAME = "inference"
REPORT_S = 10.0
"""From one line about the answers to the next, while there are any [s]."""
DESCRIPTION = """Compute the answers of a policy for a robot on this or another host. On the robot's
side runs `python -m services.policy CHECKPOINT --remote`, which needs no torch, and of the
checkpoint config.json and processor.json alone. The recurrent state travels with each request: the
server keeps nothing, so that it may be killed, started again, moved or run twice; meanwhile the
robot's hands hold and it keeps its balance."""
EXAMPLES = """examples:
  python -m services.policy.server runs/unlock/best                       on the robot's host
  python -m services.policy.server runs/unlock/best --runtime openvino    computes without torch
  python -m services.policy.server best --device cuda --mode client --host robot
"""

_log = logging.getLogger("inference")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m services.policy.server",
        description=DESCRIPTION,
        epilog=EXAMPLES,
        formatter_class=_Formatter,
    )
    parser.add_argument("checkpoint", type=Path, help="folder that training wrote")
    add_runtime_options(parser)
    group = parser.add_argument_group("bus")
    add_bus_options(group)
    group.add_argument("--robot", help="whose policy to serve (default: draco3) [TRILL_ROBOT]")
    group.add_argument(
        "--mode",
        choices=["peer", "client"],
        help="peer (default): connects to the services directly; client: reaches them through the "
        "robot's router, from another host [TRILL_MODE]",
    )
    return parser


class _Formatter(OptionFormatter, argparse.RawDescriptionHelpFormatter):
    """Help formatter that shows defaults and keeps the layout of the examples."""


def _serve(bus: BusConfig, runtime: Runtime, description: Description) -> int:
    session: Any = open_session(bus, NAME)
    server = InferenceServer(session, bus.robot, runtime, description)
    policy = description.manifest.policy
    _log.info(
        "ready: answers for %s, policy %s, checkpoint %s…",
        bus.robot,
        policy.kind,
        description.digest[:12],
    )
    due = time.monotonic() + REPORT_S
    try:
        while True:
            server.serve(0.2)
            if time.monotonic() > due:
                due = time.monotonic() + REPORT_S
                _report(server)
    finally:
        server.close()
        session.close()


def _report(server: InferenceServer) -> None:
    if server.seconds:
        ordered = sorted(server.seconds)
        _log.info(
            "%d answers: %.1f ms median, %.1f ms p99; %d requests overtaken, %d refused so far",
            len(ordered),
            1e3 * median(ordered),
            1e3 * ordered[int(0.99 * (len(ordered) - 1))],
            server.skipped,
            server.refused,
        )
        server.seconds.clear()


def main(argv: list[str] | None = None) -> int:
    """Serve until a signal; returns the exit code."""
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    arguments = _parser().parse_args(argv)

    def work() -> int:
        given = {name: getattr(arguments, name) for name in _BUS_OPTIONS}
        bus = bus_of(arguments.config, **given)
        chosen = {name: given for name, given in vars(arguments).items() if name in _OPTIONS}
        return _serve(bus, *load_runtime(validated(PolicyConfig, chosen)))

    return run_program(NAME, work)


_OPTIONS = frozenset(PolicyConfig.model_fields)
_BUS_OPTIONS = ("robot", "mode", "host", "base_port", "connect", "listen")

if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
