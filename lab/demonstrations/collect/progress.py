"""Shows the progress of a collection: a bar on a terminal, a line for each trial elsewhere."""

from collections import Counter
from collections.abc import Iterable
from time import monotonic

from rich.console import Console

from common.episodes.folder import IndexLine
from lab.demonstrations.collect.collect import CollectionProgress
from lab.demonstrations.collect.space import size
from lab.progress import ProgressBar, format_duration

_FIXED = 40
"""Columns of a terminal that the bar, the count and margins take."""


def fitting(parts: list[str], width: int) -> str:
    """Return as many of the first ``parts`` as ``width`` columns hold."""
    text = ""
    for part in parts:
        longer = f"{text}, {part}" if text else part
        if len(longer) > width:
            break
        text = longer
    return text


class CollectionBar(ProgressBar):
    """Shows the progress of a collection: successes, and rate and time left of this run."""

    def __init__(self, console: Console | None = None) -> None:
        super().__init__("episodes", console=console)
        self._began = monotonic()
        self._before: int | None = None

    def update(self, progress: CollectionProgress, line: IndexLine | None) -> None:
        """Show the progress; ``line`` is a trial that has just ended."""
        parts = self._parts(progress)
        shown = fitting(parts, self.console.width - _FIXED) or "the first are under way"
        self.show(progress.successes, progress.wanted, shown)
        if line is None:
            return
        meta = line.meta
        if not self.console.is_terminal:
            text = f"[{progress.successes}/{progress.wanted}] seed {meta.seed}: {meta.verdict}"
            self.say(f"{text} at {meta.completion_time:.1f} s; {', '.join(parts)}")
        if not meta.success:
            self.say(f"seed {meta.seed}: {meta.verdict}: {meta.reason}")

    def _parts(self, progress: CollectionProgress) -> list[str]:
        """Return parts of a line, the most important first, as ``ETA 0:34``, ``212 an hour``."""
        if self._before is None:
            self._before = progress.successes
        elapsed, made = monotonic() - self._began, progress.successes - self._before
        failed = len(progress.lines) - progress.successes
        parts = []
        if made:
            left = max(0, progress.wanted - progress.successes) * elapsed / made
            parts.append(f"ETA {format_duration(left)}")
        if failed:
            parts.append(f"{failed} failed")
        if progress.simulated:
            parts.append(f"{progress.simulated / elapsed:.2f} x real time")
        if progress.successes:
            total = progress.bytes * max(1.0, progress.wanted / progress.successes)
            parts.append(f"{size(progress.bytes)} of {size(total)}")
        if made:
            parts.append(f"{3600 * made / elapsed:.0f} an hour")
        return parts


def closing(progress: CollectionProgress, elapsed: float) -> str:
    """Return a summary of the run, in a few lines."""
    new = len(progress.lines) - progress.resumed
    lines = [
        f"{progress.successes} of {progress.wanted} successes from {len(progress.lines)} trials"
        + (f", {progress.resumed} of these from before" if progress.resumed else "")
    ]
    if new:
        lines.append(
            f"{new} trials in {format_duration(elapsed)}: "
            f"{progress.simulated:.0f} s of robot time, "
            f"{progress.simulated / elapsed:.2f} x real time together, "
            f"{progress.simulated / progress.busy:.2f} x a worker "
            f"({100 * progress.rendering / progress.busy:.0f} % of its time for pictures)"
        )
    lines += failures(progress.lines.values())
    return "\n".join(lines)


def failures(lines: Iterable[IndexLine]) -> list[str]:
    """Return ``3 x failure: not within 20 s: ...`` for each reason, the commonest first."""
    metas = (line.meta for line in lines)
    reasons = Counter(f"{meta.verdict}: {meta.reason}" for meta in metas if not meta.success)
    return [f"{number} x {reason}" for reason, number in reasons.most_common()]
