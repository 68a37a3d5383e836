"""Which moments of a run with a scored task deserve a picture. Pure."""

from collections.abc import Iterator
from itertools import pairwise

from common.schemas import TaskStatus, TaskVerdict
from lab.review.film import Film, Moment, trial_of

START = "start"


def task_moments(film: Film, wanted: int = 8) -> list[Moment]:
    """The start, every stage when it was done, every undesired contact, verdicts and a fall.

    Where these are fewer than ``wanted``, the longest times between them are halved, under the
    name of what the operator was doing.
    """
    if not film.truth:
        return []
    labels: dict[int, list[str]] = {}
    for index, label in _events(film):
        labels.setdefault(index, []).append(label)
    if film.fell is not None:
        labels.setdefault(film.fell, []).append("FELL")
    last = film.news[-1] if film.news else None
    if last is None or last[1].verdict is TaskVerdict.RUNNING:
        labels.setdefault(len(film.truth) - 1, [])
    _fill(labels, wanted)
    return [
        Moment(index, "; ".join(labels[index]) or film.label_at(index)) for index in sorted(labels)
    ]


def trial_seconds(film: Film, index: int) -> float:
    """Time of the trial at a ground truth [s]; 0 before the trial's clock starts."""
    zero = film.truth[index].header.stamp
    for number, (at, status) in enumerate(film.news):
        if at > index and number:
            break
        # The clock stands still once it is over.
        if status.verdict is TaskVerdict.RUNNING and status.time > 0.0:
            zero = status.header.stamp - round(status.time * 1e9)
    return max(0.0, (film.truth[index].header.stamp - zero) * 1e-9)


def _events(film: Film) -> Iterator[tuple[int, str]]:
    """What happened in all trials of the film, in the order of time."""
    before: TaskStatus | None = None
    for index, status in film.news:
        if before is not None and trial_of(before) != trial_of(status):
            before = None
        if status.time > 0.0 and (before is None or before.time == 0.0):
            yield index, START
        known = {stage.name for stage in before.stages if stage.done} if before else set()
        yield from ((index, s.name) for s in status.stages if s.done and s.name not in known)
        touched = {touch.name for touch in before.undesired} if before else set()
        for touch in status.undesired:
            if touch.name not in touched:
                yield index, f"undesired: {touch.name}"
        running = before is None or before.verdict is TaskVerdict.RUNNING
        if running and status.verdict is not TaskVerdict.RUNNING:
            yield index, status.verdict.name
        before = status


def _fill(labels: dict[int, list[str]], wanted: int) -> None:
    """Halve the longest gaps between the moments until there are enough."""
    while 2 <= len(labels) < wanted:
        first, second = max(pairwise(sorted(labels)), key=lambda pair: pair[1] - pair[0])
        if second - first < 2:
            return
        labels[(first + second) // 2] = []


def standing_at(film: Film, index: int) -> str:
    """Task, verdict, what was done last and what the operator was doing at a ground truth."""
    status = next((status for at, status in reversed(film.news) if at <= index), None)
    if status is None:
        return film.label_at(index)
    done = [stage.name for stage in status.stages if stage.done]
    words = [status.task, status.verdict.name.lower(), f"{len(done)}/{len(status.stages)} stages"]
    return "  ".join([*words, *done[-1:], f"({film.label_at(index)})"]).replace("  ()", "")
