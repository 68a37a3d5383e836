"""Kill the recorder with SIGKILL, repair its file and compare it with what had been sent."""

import random
import signal
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

from mcap.reader import make_reader
from pydantic import Field

from common.schemas import EpisodeAction
from common.topics import EPISODE
from deploy.ports import reserve_base_port
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support import probes
from verification.faults.support.messages import ROBOT_RATES
from verification.faults.support.probes import Sent, read_journal
from verification.faults.support.process import TIMEOUT_S, Process

RECORDING_BYTES = 20_000
"""A file of this size holds messages."""
MAX_LOSS_S = LoggerConfig().flush_period + LoggerConfig().drain_period + 0.1
"""What arrives between two flushes can be lost, and what arrives during one write [s]."""


class KillRecorder(FaultPlan):
    """Kill recorders one after the other beside one source."""

    name = "kill_recorder"
    setup = "a source of a robot's full traffic and a recorder"
    fault = "the recorder is killed (SIGKILL) at a random moment"
    recovery = "its file can be repaired and holds everything up to the last flush"
    promises = (
        Promise("a killed recorder loses what came after its last flush", "lost [s]", MAX_LOSS_S),
        Promise("nothing is missing before that", "gaps", 0),
        Promise("the file repairs, and any MCAP reader takes it", "defects", 0),
    )
    quick: ClassVar = {"kills": 3}

    kills: int = Field(default=20, ge=1, description="kills for each kind of pictures")
    pictures: tuple[Literal["jpeg", "raw", "none"], ...] = Field(
        default=("jpeg", "raw"), min_length=1, description="what the cameras send"
    )
    longest: float = Field(default=4.0, gt=0.3, description="latest moment of a kill [s]")
    seed: int = Field(default=0, description="seed of the random moments")

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each kill; see the base class."""
        for pictures in self.pictures:
            rng = random.Random(f"{self.seed} {pictures}")
            with tempfile.TemporaryDirectory() as name, reserve_base_port() as port:
                journal, bus = Path(name) / "sent.bin", ("--base-port", str(port))
                options = ("--role", "source", "--pictures", pictures, "--journal", str(journal))
                with Process(probes.MODULE, *options, *bus) as source:
                    _wait_for_bytes(journal, 1, source)
                    for number in range(self.kills):
                        progress(f"recorder {number + 1} of {self.kills}, {pictures} pictures")
                        folder = Path(name) / str(number)
                        after = rng.uniform(0.3, self.longest)
                        yield {"pictures": pictures, **_kill(bus, folder, journal, after)}


def _kill(bus: Sequence[str], folder: Path, journal: Path, after: float) -> Row:
    """Start a recorder, kill it after some seconds of recording, repair and judge its file."""
    log = folder / "log.mcap"
    with Process("services.logger", "--out", str(folder), *bus) as recorder:
        _wait_for_bytes(log, RECORDING_BYTES, recorder)
        time.sleep(after)
        killed_ns = time.monotonic_ns()
        recorder.send_signal(signal.SIGKILL)
    time.sleep(5.0 * probes.FLUSH_S)
    sent = [one for one in read_journal(journal) if one.end_ns <= killed_ns]
    started = time.monotonic()
    messages = repair(log).messages
    repair_s = time.monotonic() - started
    defects = [*_file_defects(log, messages), *_episode_defects(log)]
    return {
        "killed after [s]": after,
        "messages": messages,
        "file [MB]": 1e-6 * log.stat().st_size,
        **_losses(log, sent, killed_ns),
        "repair [s]": repair_s,
        "defects": len(defects),
        "what": "; ".join(defects),
    }


def _file_defects(log: Path, messages: int) -> list[str]:
    """Check the repaired file with the project's own check and with a stock MCAP reader."""
    defects = []
    if fault := fault_of(log):
        defects.append(f"repaired, but {fault}")
    with log.open("rb") as stream:
        found = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
    if found != messages:
        defects.append(f"stock reader finds {found} of {messages} messages")
    before = log.read_bytes()
    if repair(log).fault or log.read_bytes() != before:
        defects.append("a second repair changed the file")
    return defects


def _losses(log: Path, sent: Sequence[Sent], killed_ns: int) -> dict[str, float]:
    """Return the longest time lost, the messages lost at the end, and the gaps before it."""
    recovered: defaultdict[str, set[int]] = defaultdict(set)
    for entry in LogReader(log).raw_messages():
        if entry.topic is not None:
            recovered[entry.topic.name].add(entry.sequence)
    loss, lost, gaps = 0.0, 0, 0
    for topic, rate in ROBOT_RATES.items():
        seqs, mine = recovered[topic.name], [one for one in sent if one.topic == topic.name]
        if not seqs:
            # A slow topic may have sent nothing since the recorder subscribed.
            loss = max(loss, float("inf") if mine and rate >= 10 else 0.0)
            continue
        gaps += max(seqs) - min(seqs) + 1 - len(seqs)
        missed = [one for one in mine if one.seq > max(seqs)]
        lost += len(missed)
        if missed:
            loss = max(loss, 1e-9 * (killed_ns - missed[0].end_ns))
    return {"lost [s]": loss, "messages lost": lost, "gaps": gaps}


def _episode_defects(log: Path) -> list[str]:
    """Check that the index of episodes agrees with the recovered marks."""
    marks: list[Any] = [message for topic, message in LogReader(log).messages() if topic is EPISODE]
    ends = {mark.episode for mark in marks if mark.action is EpisodeAction.END}
    starts = [mark.episode for mark in marks if mark.action is EpisodeAction.START]
    expected = [(n, "complete" if n in ends else "interrupted") for n in starts]
    found = [(one.episode, one.outcome) for one in read_info(log).episodes]
    return [] if found == expected else [f"episodes {found}, expected {expected}"]


def _wait_for_bytes(path: Path, size: int, writer: Process) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not (path.exists() and path.stat().st_size >= size):
        if not writer.running or time.monotonic() > deadline:
            raise FaultError(f"{writer.name} wrote nothing to {path.name}")
        time.sleep(0.01)
