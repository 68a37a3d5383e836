"""``python -m deploy.router``: a Zenoh router for all clients that are not on the control path.

The services of the port table (:mod:`common.ports`) exchange messages directly, as peers.
Loggers, viewers, headsets and GPU hosts connect to this router instead: a peer then sends each
message to the router once, however many clients subscribe, and a client that is paused or behind a
bad network fills the router's queue only. The router connects to the services, not they to it, so
that it may start last, stop first and be restarted.
"""

import argparse
import logging
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from common.errors import TrillError, report
from common.ports import DEFAULT_BASE_PORT, ROUTER_OFFSET
from common.runtime.live.stopping import StopSignals
from common.transport.config import BusConfig, bus_of
from common.transport.options import add_bus_options
from common.transport.session import open_session

NAME = "router"
LOOK_PERIOD = 0.2
"""Period of looking at the connections, and the time within which a signal is noticed [s]."""

DESCRIPTION = f"""Zenoh router beside the services. It listens on one port (by default the one below
the base port: {DEFAULT_BASE_PORT + ROUTER_OFFSET}) and connects to every service of the port table.
Loggers, viewers, headsets and GPU hosts attach to it with TRILL_MODE=client; the services' own
exchange does not pass through it and continues whatever happens to it or its clients. It may be
started, stopped and restarted at any time; clients reconnect by themselves."""
EPILOG = """examples:
  python -m deploy.router                                  beside services on the standard ports
  python -m deploy.router --base-port 7464                 beside a second system
  python -m deploy.router --listen tcp/0.0.0.0:7447        open to the network; see below
  python -m deploy.router --connect tcp/sim:7448,tcp/wbc:7449      services on other machines

attach to it:
  TRILL_MODE=client TRILL_CONNECT=tcp/127.0.0.1:7447 trill top
  python -m services.logger --mode client --connect tcp/robot:7447 --out runs/far

Whoever reaches the listening port can read and publish everything, commands included. Leave it on
loopback, or set TLS and access control under [bus.zenoh] of the file given to --config.

exit codes: 0 after SIGINT or SIGTERM, 1 if the port is not free, 2 for wrong options.
"""

_log = logging.getLogger("trill.router")


def router_config(bus: BusConfig) -> BusConfig:
    """Return the bus configuration of the router beside the services of ``bus``.

    It listens where ``bus`` says, or else on the port below its base port, and connects to what
    ``bus`` names, or else to the whole port table. The mode of ``bus`` is ignored.
    """
    listen = bus.listen or (bus.endpoint(ROUTER_OFFSET),)
    return bus.model_copy(update={"mode": "router", "listen": listen})


def describe(kinds: Sequence[str]) -> str:
    """Return connections, each ``peer``, ``client`` or ``router``, in words: ``3 peers, 1 client``.

    It is ``nobody`` for none.
    """
    counts = Counter(kinds)
    words = [
        f"{counts[kind]} {kind}{'s' * (counts[kind] != 1)}"
        for kind in ("peer", "client", "router")
        if counts[kind]
    ]
    return ", ".join(words) or "nobody"


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = argparse.ArgumentParser(
        prog="python -m deploy.router",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_bus_options(result)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Route until SIGINT or SIGTERM; returns the exit code."""
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    arguments = parser().parse_args(argv)
    stop = StopSignals().install()
    try:
        route(router_config(bus_of(**vars(arguments))), stop)
    except TrillError as error:
        return report(NAME, error)
    return 0


def route(config: BusConfig, stop: StopSignals) -> None:
    """Route until ``stop``, logging the connections whenever they change.

    Raises:
        BusError: an endpoint cannot be listened on.
    """
    session: Any = open_session(config, NAME, lambda: stop.requested)
    try:
        _log.info("listening on %s", ", ".join(config.listen_endpoints(NAME)))
        shown = ""
        while not stop.requested:
            now = describe([str(transport.whatami) for transport in session.info.transports()])
            if now != shown:
                _log.info("connected: %s", now)
                shown = now
            time.sleep(LOOK_PERIOD)
    finally:
        session.close()
    _log.info("stopped")


if __name__ == "__main__":
    raise SystemExit(main())
