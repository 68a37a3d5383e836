"""``python -m verification.faults.support.slow_reader``: subscribe to everything a robot publishes.

Prints :data:`READY` when it has subscribed; reads until a signal.
"""

import argparse
import time
from typing import Any

from common.runtime.live.stopping import StopSignals
from common.transport.config import BusConfig
from common.transport.session import open_session

MODULE = "verification.faults.support.slow_reader"
READY = "ready"


def main() -> None:
    """Read until a signal."""
    parser = argparse.ArgumentParser(prog=f"python -m {MODULE}", description=__doc__)
    parser.add_argument("--mode", choices=["peer", "client"], default="peer", help="Zenoh mode")
    parser.add_argument("--connect", required=True, help="Zenoh endpoint")
    parser.add_argument("--nap", type=float, default=0.0, help="sleep after each message [s]")
    arguments = parser.parse_args()
    stop = StopSignals().install()
    config = BusConfig(mode=arguments.mode, connect=(arguments.connect,))
    session: Any = open_session(config, "reader")

    def read(sample: Any) -> None:
        sample.payload.to_bytes()
        if arguments.nap:
            time.sleep(arguments.nap)

    subscriber = session.declare_subscriber(f"{config.robot}/**", read)
    print(READY, flush=True)
    while not stop.requested:
        time.sleep(0.05)
    subscriber.undeclare()
    session.close()


if __name__ == "__main__":
    main()
