r"""Training from pictures: samples per second of this project's BC-RNN and of robomimic's.

Both learn from the same number of random demonstrations in memory, with networks of the same sizes:
a ResNet18 with spatial soft-max for each of two cameras, an LSTM, layers after it and a mixture of
Gaussians. A sample is one frame of a window, with the pictures of both cameras; batches are drawn
and put together in the measured time, and a step ends with the new weights. Each process has one
thread; they take turns, a few steps each in every round, so that noise of the machine hits all
alike. Samples per second of processor time are robust on a busy machine, those per second of wall
time need a quiet one. The ratio is the median of the rounds' own ratios.

robomimic computes in 32 bits. This project does so too, or multiplies in 16 bits (bfloat16) where
the processor has instructions for it; where it has, there is a row for either.

    python benchmarks/bench_training.py [--peer-python PYTHON] [--rounds N] [--size WIDTH HEIGHT]

The peer's interpreter is one of a virtual environment of its own:

    python -m venv /tmp/robomimic
    /tmp/robomimic/bin/pip install torch==2.13.0
    /tmp/robomimic/bin/pip install --no-deps robomimic==0.3.0 torchvision==0.28.0
    /tmp/robomimic/bin/pip install h5py imageio matplotlib six termcolor tqdm

Use the same torch on both sides. A torchvision that was compiled for another torch will do: of it
only the definition of ResNet18 is used. The exit code is 1 if the ratio is below what is wanted.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, Self

from benchmarks.builds import OWN_ROOT, Build
from benchmarks.rounds import ONE_THREAD, WorkloadError
from lab.progress import ProgressBar
from services.policy.bc_rnn.configuration import BcRnnConfig
from services.policy.configuration import InputConfig

WANTED = 2.0
"""Samples per second of processor time, by the peer's."""
OWN = ("-m", "benchmarks.workloads.training")
PEER = ("-m", "benchmarks.workloads.robomimic_training")


class Turn(NamedTuple):
    """What some steps took [s], and their mean loss."""

    wall: float
    cpu: float
    loss: float


class Spread(NamedTuple):
    """Median and range of the rounds."""

    middle: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """Return those of ``values``, one for each round."""
        return cls(median(values), min(values), max(values))

    def __str__(self) -> str:
        return f"{self.middle:.3g} ({self.least:.3g}-{self.most:.3g})"


class Trainer:
    """A process that trains when it is asked to; a context manager.

    Attributes:
        name: what it trains, and how.
        parameters: of its network.
    """

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        """Start it, and wait until it is ready.

        Raises:
            WorkloadError: it cannot train.
        """
        self._errors = folder / "stderr.txt"
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(
                command,
                env=Build("ours", OWN_ROOT).environment | ONE_THREAD,
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        try:
            about = self._answer()
        except WorkloadError:
            self.close()
            raise
        self.name, self.parameters = str(about["name"]), int(about["parameters"])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def turn(self, steps: int) -> Turn:
        """Take ``steps`` steps.

        Raises:
            WorkloadError: it failed.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(f"{steps}\n")
        self._process.stdin.flush()
        return Turn(**self._answer())

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            said = self._errors.read_text(errors="replace").splitlines()[-5:]
            raise WorkloadError("\n".join((f"{self._process.args!r} failed:", *said)))
        answer: dict[str, Any] = json.loads(line)
        return answer


def work_of(size: tuple[int, int], batch: int, window: int) -> dict[str, Any]:
    """Return what all processes are to do: settings of the policy, sizes of data and batches."""
    policy = BcRnnConfig(inputs=InputConfig(picture_size=size))
    # A set-point, both grippers and the number of the gait.
    action = policy.actions.shape[1] + 2 + 1
    return {
        "policy": policy.model_dump(mode="json"),
        "observation": policy.inputs.width,
        "action": action,
        "batch": batch,
        "window": window,
        "episodes": 4,
        "frames": max(60, batch * window // 4),
    }


def rates(turns: Sequence[Turn], samples: int, of: str) -> list[float]:
    """Return samples per second of ``of``, ``cpu`` or ``wall``, in each round."""
    return [samples / float(getattr(turn, of)) for turn in turns]


def ratio(ours: Sequence[Turn], peers: Sequence[Turn], of: str) -> Spread:
    """Return how many times as many samples as the peer's are learned in a second."""
    pairs = zip(rates(ours, 1, of), rates(peers, 1, of), strict=True)
    return Spread.of([own / peer for own, peer in pairs])


def measure(
    commands: Sequence[Sequence[str]], folder: Path, rounds: int, steps: int
) -> dict[str, list[Turn]]:
    """Return the turns of each process by its name, without a first one that warms up.

    Raises:
        WorkloadError: a process failed, or their networks differ in size by more than 2 percent.
    """
    trainers: list[Trainer] = []
    with ProgressBar("rounds", rounds + 1) as bar:
        try:
            for index, command in enumerate(commands):
                own = folder / str(index)
                own.mkdir()
                trainers.append(Trainer(command, own))
            by_name = {trainer.name: trainer for trainer in trainers}
            sizes = {name: trainer.parameters for name, trainer in by_name.items()}
            if max(sizes.values()) > 1.02 * min(sizes.values()):
                raise WorkloadError(f"expected networks of the same size, got {sizes} parameters")
            bar.say(", ".join(f"{n}: {size / 1e6:.2f} M parameters" for n, size in sizes.items()))
            turns: dict[str, list[Turn]] = {name: [] for name in by_name}
            for number in range(rounds + 1):
                for name, trainer in by_name.items():
                    turn = trainer.turn(steps)
                    if number:
                        turns[name].append(turn)
                bar.advance()
        finally:
            for trainer in trainers:
                trainer.close()
    return turns


def table(turns: dict[str, list[Turn]], samples: int, peer: str | None) -> list[str]:
    """Return the lines of the table; ``samples`` are those of a turn."""
    header = ("samples / CPU s", "samples / s (wall)", "ratio, CPU", "ratio, wall", "loss")
    lines = ["{:28}{:>22}{:>22}{:>20}{:>20}{:>9}".format("", *header)]
    for name, own in turns.items():
        cells = [str(Spread.of(rates(own, samples, of))) for of in ("cpu", "wall")]
        cells += [str(ratio(own, turns[peer], of)) if peer else "" for of in ("cpu", "wall")]
        cells.append(f"{own[-1].loss:.2f}")
        lines.append("{:28}{:>22}{:>22}{:>20}{:>20}{:>9}".format(name, *cells))
    return lines


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", help="interpreter that has robomimic; without: ours alone")
    parser.add_argument("--rounds", type=int, default=5, help="that are measured (5)")
    parser.add_argument("--steps", type=int, default=1, help="of each process in a round (1)")
    parser.add_argument(
        "--size", type=int, nargs=2, default=(84, 84), metavar=("WIDTH", "HEIGHT"),
        help="of the pictures [pixels] (84 84)",
    )  # fmt: skip
    parser.add_argument("--batch", type=int, default=16, help="windows in a step (16)")
    parser.add_argument("--window", type=int, default=10, help="frames in a window (10)")
    arguments = parser.parse_args()
    width, height = arguments.size
    work = work_of((width, height), arguments.batch, arguments.window)
    with tempfile.TemporaryDirectory() as name:
        file = Path(name, "work.json")
        file.write_text(json.dumps(work))
        commands = [[sys.executable, *OWN, str(file), how] for how in ("auto", "float32")]
        if arguments.peer_python:
            # Links are kept: an interpreter knows its environment by its path.
            python = str(Path(arguments.peer_python).absolute())
            commands.append([python, *PEER, str(file)])
        try:
            turns = measure(commands, Path(name), arguments.rounds, arguments.steps)
        except (WorkloadError, OSError) as error:
            print(f"bench_training: {error}", file=sys.stderr)
            return 2
    names = list(turns)
    peer = names[-1] if arguments.peer_python else None
    samples = arguments.batch * arguments.window * arguments.steps
    print(
        f"pictures of {width}x{height}, {arguments.batch} windows of {arguments.window} frames, "
        f"one thread; median (range) of {arguments.rounds} rounds"
    )
    print("\n".join(table(turns, samples, peer)))
    if peer is None:
        return 0
    found = ratio(turns[names[0]], turns[peer], "cpu").middle
    print(f"wanted: at least {WANTED:g} times the peer's samples per CPU second; got {found:.2f}")
    return 0 if found >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
