"""The steps of a training: learn, validate, keep what was learned."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from time import monotonic

import numpy as np

from common.files import appending
from lab.errors import TrainingError
from lab.learning.training.config import TrainingConfig
from lab.learning.training.curves import draw_curves, read_metrics
from lab.learning.training.events import Write, event_files
from lab.learning.training.folder import CURVES, METRICS, Progress, TrainingFolder
from lab.learning.training.learner import Learner, Metrics, learning_rate
from lab.learning.training.processes import Processes
from lab.learning.training.windows import Spread, Windows
from lab.progress import ProgressBar
from lab.trials.folder import disk_errors

Keep = Callable[[Progress], None]
"""Writes a checkpoint of what was learned so far."""


def run_steps(
    learner: Learner,
    folder: TrainingFolder,
    config: TrainingConfig,
    windows: tuple[Windows, Windows],
    spreads: tuple[Spread, Spread | None],
    keep: Keep,
    processes: Processes,
) -> Progress:
    """Learn until all steps are done or the time is up; go on where the folder's state is.

    Args:
        learner: what learns.
        folder: where state and metrics are kept.
        config: of training.
        windows: to learn from, and to validate on.
        spreads: noise on observations, and on numbers of the scene in place of an estimate.
        keep: called after each validation, by the first process.
        processes: that learn together.

    Raises:
        TrainingError: the loss is no number any more, or the disk fails.
    """
    progress = folder.load_state(learner)
    learned, held_out = windows
    part = processes.part(config.batch)
    batches = held_out.whole(config.batch) if processes.first else []
    earlier, began, gathered = progress.seconds, monotonic(), list[Metrics]()
    with (
        event_files(folder.root, progress.step) if processes.first else nullcontext() as events,
        ProgressBar("training", None if config.minutes else config.steps) as bar,
    ):
        while (done := part_done(config, progress)) < 1.0:
            rng = np.random.default_rng((config.seed, progress.step))
            batch = learned.draw(rng, config.batch, *spreads, part)
            gathered.append(learner.learn(batch, done))
            seconds = earlier + monotonic() - began
            if config.minutes:
                seconds = processes.agreed(seconds)
            progress = progress.model_copy(update={"step": progress.step + 1, "seconds": seconds})
            bar.show(progress.step, text=f"loss {gathered[-1]['loss']:.2f}")
            over = part_done(config, progress) >= 1.0
            if events is None or (progress.step % config.validate_every and not over):
                continue
            valid = learner.validate(batches)
            if progress.best_loss is None or valid["loss"] < progress.best_loss:
                better = {"best_step": progress.step, "best_loss": valid["loss"]}
                progress = progress.model_copy(update=better)
            keep(progress)
            folder.save_state(learner, progress)
            rate = learning_rate(config, done)
            _report(folder, progress, rate, _mean(gathered), valid, bar, events)
            gathered.clear()
    return progress


def part_done(config: TrainingConfig, progress: Progress) -> float:
    """Return which part of the training is done, from 0 to 1."""
    if config.minutes is not None:
        return progress.seconds / (60.0 * config.minutes)
    return progress.step / config.steps


def _mean(gathered: list[Metrics]) -> Metrics:
    return {name: float(np.mean([one[name] for one in gathered])) for name in gathered[0]}


def _report(
    folder: TrainingFolder,
    progress: Progress,
    rate: float,
    learned: Metrics,
    held_out: Metrics,
    bar: ProgressBar,
    events: Write,
) -> None:
    """Append a line to the metrics, draw them, and say how it goes."""
    line = {"step": progress.step, "seconds": round(progress.seconds, 3), "rate": rate}
    path = folder.root / METRICS
    with disk_errors(path, TrainingError):
        with appending(path) as append:
            append(json.dumps(line | {"train": learned, "held_out": held_out}))
        draw_curves(read_metrics(path), folder.root / CURVES)
        named = {f"train/{name}": value for name, value in learned.items()}
        named |= {f"held_out/{name}": value for name, value in held_out.items()}
        events(progress.step, named | {"rate": rate})
    terms = ", ".join(f"{name} {value:.3f}" for name, value in held_out.items() if name != "loss")
    bar.say(
        f"step {progress.step}: loss {learned['loss']:.3f}, on held-out episodes "
        f"{held_out['loss']:.3f} ({terms})"
    )
