"""``python -m verification.faults.kill_recorder``: kill the recorder and look at what is left.

A synthetic robot publishes at full rate over Zenoh. The recorder is started, killed with SIGKILL at
a random moment, and its file repaired and compared with what had been sent until then.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from mcap.reader import make_reader

from common.topics import EPISODE
from deploy.ports import reserve_base_port
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of
from verification.faults.robot_load import RATES, Sent, read_journal

MAX_LOSS_S = 1.0
"""What may be lost of each topic, from the kill backwards [s]."""
_START_S = 60.0
_SETTLE_S = 0.5


@dataclass(frozen=True)
class Trial:
    """One kill.

    Attributes:
        pictures: what the cameras sent.
        after_s: from the first recorded byte to the kill.
        messages: in the repaired file.
        loss_s: kill minus sending of the last recovered message, of the topic that lost most.
        lost: messages sent before the kill, after the first recorded, that are not in the file.
        gaps: missing between a topic's first and last recovered message.
        repair_s: what the repair took.
        size: of the file [bytes].
        faults: what was wrong, in words; empty for a good trial.
    """

    pictures: str
    after_s: float
    messages: int
    loss_s: float
    lost: int
    gaps: int
    repair_s: float
    size: int
    faults: tuple[str, ...]


def run_trials(
    pictures: str, kills: int, seed: int, work: Path, longest: float = 4.0
) -> Iterator[Trial]:
    """Kill ``kills`` recorders of one robot, at moments drawn with ``seed``."""
    rng = random.Random(f"{seed} {pictures}")
    journal = work / f"sent-{pictures}.bin"
    with reserve_base_port() as port, _load(port, pictures, journal):
        for number in range(kills):
            yield _trial(
                port, pictures, journal, work / f"{pictures}-{number}", rng.uniform(0.3, longest)
            )


def _trial(port: int, pictures: str, journal: Path, out: Path, after: float) -> Trial:
    log = out / "log.mcap"
    with _process("services.logger", "--out", str(out), "--base-port", str(port)) as recorder:
        _wait_for(log, recorder)
        time.sleep(after)
        killed_ns = time.monotonic_ns()
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.wait()
    # The journal is flushed every tenth of a second.
    time.sleep(_SETTLE_S)
    sent = [one for one in read_journal(journal) if one.at_ns <= killed_ns]
    started = time.monotonic()
    done = repair(log)
    took = time.monotonic() - started
    faults = _faults_of_file(log, done.messages)
    loss, lost, gaps = _compare(log, sent, killed_ns)
    if loss > MAX_LOSS_S:
        faults.append(f"{loss:.2f} s lost")
    if gaps:
        faults.append(f"{gaps} messages missing within")
    faults += _episode_faults(log)
    size = log.stat().st_size
    return Trial(pictures, after, done.messages, loss, lost, gaps, took, size, tuple(faults))


def _faults_of_file(log: Path, messages: int) -> list[str]:
    """What a stock MCAP reader and our own check have against the repaired file."""
    faults = []
    fault = fault_of(log)
    if fault:
        faults.append(f"repaired, but {fault}")
    with log.open("rb") as stream:
        found = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
    if found != messages:
        faults.append(f"stock reader finds {found} of {messages} messages")
    before = log.read_bytes()
    if repair(log).fault or log.read_bytes() != before:
        faults.append("a second repair changed the file")
    return faults


def _compare(log: Path, sent: list[Sent], killed_ns: int) -> tuple[float, int, int]:
    """Longest time lost, messages lost, and messages missing within what was recovered."""
    recovered: dict[str, set[int]] = {}
    reader = LogReader(log)
    for entry in reader.raw_messages():
        if entry.topic is not None:
            recovered.setdefault(entry.topic.name, set()).add(entry.sequence)
    loss = 0.0
    lost = gaps = 0
    for topic, rate in RATES:
        seqs = recovered.get(topic.name, set())
        mine = [one for one in sent if one.topic == topic.name]
        if not mine:
            continue
        if not seqs:
            # Nothing of this topic: fine only if none was due since the recorder could hear.
            loss = max(loss, 0.0 if rate < 10 else float("inf"))
            continue
        first, last = min(seqs), max(seqs)
        gaps += last - first + 1 - len(seqs)
        missed = [one for one in mine if one.seq > last]
        lost += len(missed)
        if missed:
            loss = max(loss, 1e-9 * (killed_ns - missed[0].at_ns))
    return loss, lost, gaps


def _episode_faults(log: Path) -> list[str]:
    """Whether each recovered mark is in the index of episodes as it should be."""
    marks: list[tuple[int, int]] = []
    for topic, message in LogReader(log).messages():
        if topic is EPISODE:
            marks.append((message.episode, int(message.action)))  # type: ignore[attr-defined]
    starts = [number for number, action in marks if action == 0]
    ends = {number for number, action in marks if action == 1}
    expected = [(n, "complete" if n in ends else "interrupted") for n in starts]
    found = [(one.episode, one.outcome) for one in read_info(log).episodes]
    return [] if found == expected else [f"episodes {found}, expected {expected}"]


@contextmanager
def _load(port: int, pictures: str, journal: Path) -> Iterator[None]:
    words = ("--base-port", str(port), "--pictures", pictures, "--journal", str(journal))
    with _process("verification.faults.robot_load", *words) as load:
        deadline = time.monotonic() + _START_S
        while not (journal.exists() and journal.stat().st_size):
            if load.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("the synthetic robot did not start")
            time.sleep(0.05)
        yield
        if load.poll() is not None:
            raise RuntimeError(f"the synthetic robot ended with {load.returncode}")


@contextmanager
def _process(module: str, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    process = subprocess.Popen(
        [sys.executable, "-m", module, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _wait_for(log: Path, recorder: "subprocess.Popen[bytes]") -> None:
    """Wait until messages are in the file."""
    deadline = time.monotonic() + _START_S
    while not (log.exists() and log.stat().st_size > 20_000):
        if recorder.poll() is not None or time.monotonic() > deadline:
            how = "still runs" if recorder.poll() is None else f"ended with {recorder.returncode}"
            raise RuntimeError(f"the recorder recorded nothing and {how}")
        time.sleep(0.01)


def _line(number: int, trial: Trial) -> str:
    return (
        f"{number:>4} {trial.pictures:>8} {trial.after_s:>8.2f} {trial.messages:>9} "
        f"{1e-6 * trial.size:>8.2f} {trial.loss_s:>8.3f} {trial.lost:>6} {trial.gaps:>5} "
        f"{trial.repair_s:>9.2f}  {'; '.join(trial.faults) or 'ok'}"
    )


def main(argv: list[str] | None = None) -> int:
    """Run the study; 1 if a trial was not good."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.kill_recorder",
        description=(__doc__ or "").split(":", 1)[1].strip(),
        epilog="example: python -m verification.faults.kill_recorder --kills 5 --pictures raw",
    )
    parser.add_argument("--kills", type=int, default=20, help="of each condition (20)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (0)")
    parser.add_argument(
        "--pictures", choices=["jpeg", "raw", "none"], action="append", help="(jpeg, then raw)"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/studies/kill_recorder.json"))
    arguments = parser.parse_args(argv)
    trials: list[Trial] = []
    print(" kill pictures after[s]  messages size[MB]  loss[s]   lost  gaps repair[s]")
    for pictures in arguments.pictures or ["jpeg", "raw"]:
        with tempfile.TemporaryDirectory() as work:
            for trial in run_trials(pictures, arguments.kills, arguments.seed, Path(work)):
                trials.append(trial)
                print(_line(len(trials), trial), flush=True)
    losses = sorted(trial.loss_s for trial in trials)
    bad = sum(bool(trial.faults) for trial in trials)
    print(
        f"{len(trials) - bad} of {len(trials)} good; loss median {losses[len(losses) // 2]:.3f} s, "
        f"worst {losses[-1]:.3f} s (at most {MAX_LOSS_S:g})"
    )
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"seed": arguments.seed, "trials": [asdict(t) for t in trials]}, indent=2)
    arguments.out.write_text(text + "\n", encoding="utf-8")
    print(arguments.out)
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
