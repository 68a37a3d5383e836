"""Kill, pause or hang a service and measure how soon its reader's runner misses it."""

import random
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import ClassVar

import numpy as np
from pydantic import Field

from deploy.ports import reserve_base_port
from verification.faults.plan import FaultPlan, Progress, Promise, Row
from verification.faults.support import probes
from verification.faults.support.process import FAULTS, Process

SETTLE_S = 2.0
PAUSE_S = 0.2
"""Time from the detection until a paused source goes on [s]."""
QUIET_S = (0.3, 0.6)
"""Range of the time between the source's return and the next fault [s]."""


class DeadPeer(FaultPlan):
    """Inject each fault again and again."""

    name = "dead_peer"
    setup = "a source and a reader as processes under the live runner"
    fault = "the source is killed (SIGKILL), paused (SIGSTOP) or hangs in a step"
    recovery = "the reader's runner reports it dead, and alive again after its return"
    promises = (Promise("a dead service is missed within 0.1 s", "max [ms]", 100.0),)
    quick: ClassVar = {"times": 4}

    times: int = Field(default=20, ge=1, description="times each fault")
    seed: int = Field(default=0, description="seed of the random moments")

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each kind of fault; see the base class."""
        rng = random.Random(self.seed)
        with reserve_base_port() as port, ExitStack() as stack:

            def start(role: str) -> Process:
                process = Process(probes.MODULE, "--role", role, "--base-port", str(port))
                return stack.enter_context(process)

            reader, source = start("reader"), start("source")
            reader.expect(probes.CONNECTED)
            time.sleep(SETTLE_S)
            reader.count("")
            for fault in FAULTS:
                missed, back, false_alarms = [], [], 0
                for turn in range(self.times):
                    progress(f"{fault}, {turn + 1} of {self.times}")
                    time.sleep(rng.uniform(*QUIET_S))
                    false_alarms += reader.count(probes.DEAD)
                    began = time.monotonic()
                    source.inject(fault)
                    missed.append(_time_of(reader.expect(probes.DEAD)) - began)
                    returned = began + probes.HANG_S
                    if fault == "killed":
                        source.kill()
                        source, returned = start("source"), time.monotonic()
                    elif fault == "paused":
                        time.sleep(PAUSE_S)
                        source.send_signal(signal.SIGCONT)
                        returned = time.monotonic()
                    back.append(_time_of(reader.expect(probes.ALIVE)) - returned)
                yield {
                    "fault": fault,
                    "times": self.times,
                    "missed after p50 [ms]": 1e3 * float(np.median(missed)),
                    "p90 [ms]": 1e3 * float(np.percentile(missed, 90)),
                    "max [ms]": 1e3 * max(missed),
                    "alive again p50 [ms]": 1e3 * float(np.median(back)),
                    "alive again max [ms]": 1e3 * max(back),
                    "false alarms": false_alarms,
                }


def _time_of(line: str) -> float:
    """Return the time at which a probe printed the line [s, monotonic]."""
    return 1e-9 * int(line.split(maxsplit=1)[0])
