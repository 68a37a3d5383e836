"""Choose and caption the moments of a scored task that are worth a picture. Pure."""

from collections.abc import Iterator
from itertools import pairwise

from common.schemas import TaskStatus, TaskVerdict
from lab.review.key_moments import FELL, MAX_MOMENTS, Moment, at_most
from lab.review.timeline import Timeline, trial_of

START = "start"


def task_moments(timeline: Timeline, wanted: int = 8) -> list[Moment]:
    """Choose the start, stages' completions, undesired contacts, hand-overs, verdicts and a fall.

    If these are fewer than ``wanted``, the longest gaps between them are halved by further
    moments, captioned with the operator's label. For a run with very many see
    :func:`lab.review.key_moments.at_most`.
    """
    if not timeline.truth:
        return []
    labels: dict[int, list[str]] = {}
    for index, label in (*_events(timeline), *timeline.handovers):
        labels.setdefault(index, []).append(label)
    if timeline.fall is not None:
        labels.setdefault(timeline.fall, []).append(FELL)
    if timeline.task is None or timeline.task.verdict is TaskVerdict.RUNNING:
        labels.setdefault(len(timeline.truth) - 1, [])
    _halve_gaps(labels, wanted)
    chosen = [
        Moment(index, "; ".join(labels[index]) or timeline.label_at(index))
        for index in sorted(labels)
    ]
    return at_most(MAX_MOMENTS, chosen)


def trial_seconds(timeline: Timeline, index: int) -> float:
    """Return the trial time at a ground truth [s]; 0 before the trial's clock starts."""
    zero = timeline.truth[index].header.stamp
    for number, (at, status) in enumerate(timeline.task_changes):
        if at > index and number:
            break
        # After the verdict the status's clock stands still.
        if status.verdict is TaskVerdict.RUNNING and status.time > 0.0:
            zero = status.header.stamp - round(status.time * 1e9)
    return max(0.0, (timeline.truth[index].header.stamp - zero) * 1e-9)


def _events(timeline: Timeline) -> Iterator[tuple[int, str]]:
    """Yield (index, label) of every event of every trial, in order of time."""
    before: TaskStatus | None = None
    for index, status in timeline.task_changes:
        if before is not None and trial_of(before) != trial_of(status):
            before = None
        if status.time > 0.0 and (before is None or before.time == 0.0):
            yield index, START
        known = {stage.name for stage in before.stages if stage.done} if before else set()
        yield from ((index, s.name) for s in status.stages if s.done and s.name not in known)
        touched = {contact.name for contact in before.undesired} if before else set()
        for contact in status.undesired:
            if contact.name not in touched:
                yield index, f"undesired: {contact.name}"
        running = before is None or before.verdict is TaskVerdict.RUNNING
        if running and status.verdict is not TaskVerdict.RUNNING:
            yield index, status.verdict.name
        before = status


def _halve_gaps(labels: dict[int, list[str]], wanted: int) -> None:
    """Add moments in the middle of the longest gaps until there are ``wanted``."""
    while 2 <= len(labels) < wanted:
        first, second = max(pairwise(sorted(labels)), key=lambda pair: pair[1] - pair[0])
        if second - first < 2:
            return
        labels[(first + second) // 2] = []


def task_caption(timeline: Timeline, index: int) -> str:
    """Format task, verdict, last completed stage and the operator's label at a ground truth."""
    changes = reversed(timeline.task_changes)
    status = next((status for at, status in changes if at <= index), None)
    if status is None:
        return timeline.label_at(index)
    done = [stage.name for stage in status.stages if stage.done]
    parts = [status.task, status.verdict.name.lower(), f"{len(done)}/{len(status.stages)} stages"]
    return "  ".join([*parts, *done[-1:], f"({timeline.label_at(index)})"]).replace("  ()", "")
