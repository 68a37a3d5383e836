"""``python -m deploy.router``: the way in for everything that is not on the control path.

The services of the port table (:mod:`common.ports`) exchange messages directly, as peers.
Loggers, viewers, headsets and GPU hosts come as clients of this router instead: a peer then sends
each message to the router once, however many clients want it, and a client that stands still or
sits behind a bad network fills the router's queue and nobody else's. The router connects to the
services, not they to it, so that it may come last, go first and come back.
"""

import argparse
import logging
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import ConfigError, TrillError
from common.ports import DEFAULT_BASE_PORT, ROUTER_OFFSET
from common.runtime.live.stopping import StopSignals
from common.transport.config import BusConfig, bus_of, split_list
from common.transport.session import open_session

NAME = "router"
LOOK_PERIOD = 0.2
"""Between looks at who is connected, and so how soon a signal is heeded [s]."""

DESCRIPTION = f"""Zenoh router beside the services. It listens on one port (by default the one below
the base port: {DEFAULT_BASE_PORT + ROUTER_OFFSET}) and connects to every service of the port table.
Loggers, viewers, headsets and GPU hosts attach to it with TRILL_MODE=client; the services' own
exchange does not pass through it and goes on whatever happens to it or to its clients. It may be
started, stopped and restarted at any time; clients come back by themselves."""
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

exit codes: 0 after SIGINT or SIGTERM, 1 when the port cannot be had, 2 for wrong options.
"""

_log = logging.getLogger("trill.router")


def router_config(
    bus: BusConfig, listen: Sequence[str] | None = None, connect: Sequence[str] | None = None
) -> BusConfig:
    """The bus as its router sees it.

    Args:
        bus: the bus as a service would see it; its mode does not matter.
        listen: endpoints to listen on; None: as in ``bus``, or else the port below its base port.
        connect: endpoints of services; None: as in ``bus``, or else the whole port table.
    """
    listen = bus.listen if listen is None else tuple(listen)
    return bus.model_copy(
        update={
            "mode": "router",
            "listen": listen or (f"tcp/{bus.host}:{bus.base_port + ROUTER_OFFSET}",),
            "connect": bus.connect if connect is None else tuple(connect),
        }
    )


def describe(kinds: Sequence[str]) -> str:
    """Say who is connected, e.g. ``3 peers, 1 client``; ``nobody`` for none.

    Args:
        kinds: one of ``peer``, ``client``, ``router`` for each connection.
    """
    counts = Counter(kinds)
    words = [
        f"{counts[kind]} {kind}{'s' * (counts[kind] != 1)}"
        for kind in ("peer", "client", "router")
        if counts[kind]
    ]
    return ", ".join(words) or "nobody"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = argparse.ArgumentParser(
        prog="python -m deploy.router",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("--config", type=Path, help="TOML file for the whole stack [TRILL_CONFIG]")
    result.add_argument("--host", help="address of the port table (127.0.0.1) [TRILL_HOST]")
    result.add_argument(
        "--base-port",
        type=int,
        help=f"first port of the table ({DEFAULT_BASE_PORT}) [TRILL_BASE_PORT]",
    )
    result.add_argument(
        "--listen",
        type=split_list,
        help="endpoints for clients, by commas (tcp/HOST:BASE_PORT-1) [TRILL_LISTEN]",
    )
    result.add_argument(
        "--connect",
        type=split_list,
        help="endpoints of services, by commas (the port table) [TRILL_CONNECT]",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Route until a signal; returns the exit code."""
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    arguments = parser().parse_args(argv)
    stop = StopSignals().heed()
    try:
        bus = bus_of(arguments.base_port, arguments.config, host=arguments.host)
        route(router_config(bus, arguments.listen, arguments.connect), stop)
    except ConfigError as error:
        print(f"{NAME}: {error}", file=sys.stderr)
        return 2
    except TrillError as error:
        print(f"{NAME}: {error}", file=sys.stderr)
        return 1
    return 0


def route(config: BusConfig, stop: StopSignals) -> None:
    """Route until ``stop``, saying who comes and goes.

    Raises:
        BusError: an endpoint cannot be listened on.
    """
    session: Any = open_session(config, NAME, lambda: stop.asked)
    try:
        _log.info("listening on %s", ", ".join(config.listen_endpoints(NAME)))
        shown = ""
        while not stop.asked:
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
