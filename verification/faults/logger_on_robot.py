"""``python -m verification.faults.logger_on_robot``: does a logger disturb a walking robot?

Plant, controller, router and a scripted operator that keeps walking run live. In turn there is no
logger, one attached through the router, one that is paused (SIGSTOP) in the middle of it, and one
that is killed (-9). Conditions take turns within one run, so whatever else the machine does meets
them all alike. The controller's own loop times (ServiceHealth) and the plant's state age at the
torque (PlantStatus) are compared, and falls are counted.
"""

import argparse
import json
import signal
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.errors import SchemaError
from common.schemas import ControllerState, PlantStatus, ServiceHealth
from common.transport.config import BusConfig
from common.transport.session import open_session
from common.transport.tap import RawTap
from common.wire.codec import decode
from deploy.ports import reserve_base_port
from verification.faults.processes import running

CONDITIONS = ("none", "attached", "paused", "killed")
SETTLE_S = 3.0
"""From one condition to the next: the controller's health looks two seconds back."""


@dataclass
class Account:
    """What was seen in one condition; times in seconds."""

    loop_median: list[float] = field(default_factory=list)
    loop_p99: list[float] = field(default_factory=list)
    age_p99: list[float] = field(default_factory=list)
    misses: int = 0
    steps: int = 0
    gaits: int = 0
    fallen: bool = False


class Watcher:
    """Reads the controller's and the plant's own figures off the bus, as a peer of both."""

    def __init__(self, port: int) -> None:
        config = BusConfig(base_port=port)
        self._session: Any = open_session(config, "monitor")
        self._tap = RawTap(self._session, config.robot)
        self._health: ServiceHealth | None = None
        self._gaits = 0

    def watch(self, seconds: float, account: Account | None = None) -> None:
        """Take in what is published for a while."""
        end = time.monotonic() + seconds
        before, gaits = self._health, self._gaits
        while time.monotonic() < end:
            for sample in self._tap.drain():
                self._note(sample.key.partition("/")[2], sample.payload, account)
            time.sleep(0.05)
        if account is not None and before is not None and self._health is not None:
            account.misses += self._health.deadline_misses - before.deadline_misses
            account.steps += self._health.steps - before.steps
            account.gaits += self._gaits - gaits

    def walking(self) -> bool:
        """Whether a gait has been completed yet."""
        return self._gaits > 0

    def close(self) -> None:
        """Leave the bus."""
        self._session.close()

    def _note(self, name: str, payload: bytes, account: Account | None) -> None:
        try:
            if name == "health/wbc":
                self._health = decode(payload, ServiceHealth)
                if account is not None:
                    account.loop_median.append(self._health.step_median)
                    account.loop_p99.append(self._health.step_p99)
            elif name == "plant/status" and account is not None:
                status = decode(payload, PlantStatus)
                account.age_p99.append(status.age_at_torque_p99)
                account.fallen = account.fallen or status.fallen
            elif name == "wbc/state":
                self._gaits = decode(payload, ControllerState).gaits_completed
        except SchemaError:
            return


@contextmanager
def _robot(port: int) -> Iterator[None]:
    environment = {"TRILL_BASE_PORT": str(port)}
    with ExitStack() as stack:
        for module, *options in (
            ("services.sim",),
            ("services.wbc",),
            ("deploy.router",),
            ("services.teleop", "scripted", "--script", "random", "--count", "10000"),
        ):
            stack.enter_context(running(module, *options, environment=environment))
        yield


@contextmanager
def _logger(condition: str, port: int, folder: Path) -> Iterator[None]:
    """A logger that is there, paused or killed inside the context; or none."""
    if condition == "none":
        time.sleep(SETTLE_S)
        yield
        return
    route = ("--mode", "client", "--connect", f"tcp/127.0.0.1:{port - 1}")
    with running("services.logger", "--out", str(folder), *route) as logger:
        time.sleep(SETTLE_S)
        if condition == "paused":
            logger.send_signal(signal.SIGSTOP)
        elif condition == "killed":
            logger.kill()
        try:
            yield
        finally:
            if condition == "paused":
                logger.send_signal(signal.SIGCONT)
                time.sleep(1.0)


def measure(rounds: int, seconds: float) -> dict[str, Account]:
    """Run all conditions; returns what was seen in each."""
    accounts: defaultdict[str, Account] = defaultdict(Account)
    with (
        reserve_base_port("127.0.0.1", None) as port,
        tempfile.TemporaryDirectory() as folder,
        _robot(port),
        closing(Watcher(port)) as watcher,
    ):
        _until_walking(watcher)
        for number in range(rounds):
            for condition in CONDITIONS:
                out = Path(folder) / f"{condition}-{number}"
                with _logger(condition, port, out):
                    watcher.watch(seconds, accounts[condition])
                watcher.watch(SETTLE_S)
    return dict(accounts)


def _until_walking(watcher: Watcher, patience: float = 60.0) -> None:
    give_up = time.monotonic() + patience
    while not watcher.walking():
        if time.monotonic() > give_up:
            raise RuntimeError("the robot does not walk; expected a gait within a minute")
        watcher.watch(0.5)


def table(accounts: dict[str, Account]) -> list[dict[str, Any]]:
    """A row per condition, times in ms; the first is the reference of the ratio."""
    reference = statistics.median(accounts["none"].loop_p99)
    rows = []
    for name, account in accounts.items():
        p99 = statistics.median(account.loop_p99)
        rows.append(
            {
                "logger": name,
                "loop median": 1e3 * statistics.median(account.loop_median),
                "loop p99": 1e3 * p99,
                "loop p99 spread": [1e3 * min(account.loop_p99), 1e3 * max(account.loop_p99)],
                "ratio": p99 / reference,
                "age p99": 1e3 * statistics.median(account.age_p99),
                "misses": account.misses,
                "steps": account.steps,
                "gaits": account.gaits,
                "fallen": account.fallen,
            }
        )
    return rows


def main() -> int:
    """Measure and print; exit code 1 if the robot fell."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=3, help="times each condition (3)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each (10)")
    parser.add_argument("--out", type=Path, help="write the table as JSON here")
    options = parser.parse_args()
    rows = table(measure(options.rounds, options.seconds))
    print(
        "logger      loop ms: median    p99 [min max]      ×   age p99  missed/steps  gaits  fell"
    )
    for row in rows:
        low, high = row["loop p99 spread"]
        fell = "YES" if row["fallen"] else "no"
        print(
            f"{row['logger']:<14}{row['loop median']:>12.2f}{row['loop p99']:>7.2f} "
            f"[{low:.2f} {high:.2f}]{row['ratio']:>7.2f}{row['age p99']:>9.1f}"
            f"{row['misses']:>7}/{row['steps']}{row['gaits']:>7}  {fell}"
        )
    if options.out is not None:
        options.out.write_text(json.dumps(rows, indent=1))
    return int(any(row["fallen"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
