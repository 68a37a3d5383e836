"""How far the collection is: a bar on a terminal, a line a trial anywhere else."""

from collections import Counter
from time import monotonic

from rich.console import Console

from lab.demonstrations.collect.collect import Standing
from lab.demonstrations.collect.space import size
from lab.demonstrations.collect.store import IndexLine
from lab.progress import ProgressBar, format_duration


class Pace:
    """Rate, time left and speed of this run; what was there before does not count."""

    def __init__(self) -> None:
        self._began = monotonic()
        self._before: int | None = None

    def parts(self, standing: Standing) -> list[str]:
        """Most important first, as ``ETA 0:34``, ``64 % successes``, ``212 an hour``."""
        if self._before is None:
            self._before = standing.successes
        elapsed = monotonic() - self._began
        made = standing.successes - self._before
        parts = []
        if made:
            left = max(0, standing.wanted - standing.successes) * elapsed / made
            parts.append(f"ETA {format_duration(left)}")
        failed = len(standing.lines) - standing.successes
        if failed:
            parts.append(f"{failed} failed")
        if standing.simulated:
            parts.append(f"{standing.simulated / elapsed:.2f} x real time")
        if standing.successes:
            kept = sum(line.bytes for line in standing.lines.values())
            total = kept * max(1.0, standing.wanted / standing.successes)
            parts.append(f"{size(kept)} of {size(total)}")
        if made:
            parts.append(f"{3600 * made / elapsed:.0f} an hour")
        return parts


_FIXED = 40
"""Columns of a terminal that bar, count and margins take."""


def fitting(parts: list[str], width: int) -> str:
    """As many of ``parts`` as ``width`` columns hold, the first ones."""
    text = ""
    for part in parts:
        longer = f"{text}, {part}" if text else part
        if len(longer) > width:
            break
        text = longer
    return text


class Display(ProgressBar):
    """Shows the standing while it changes."""

    def __init__(self, console: Console) -> None:
        super().__init__("episodes", console=console)
        self._pace = Pace()

    def tell(self, standing: Standing, line: IndexLine | None) -> None:
        """Show how it stands; ``line`` is a trial that has just ended."""
        parts = self._pace.parts(standing)
        shown = fitting(parts, self.console.width - _FIXED) or "the first are under way"
        self.show(standing.successes, standing.wanted, shown)
        if line is None:
            return
        meta = line.meta
        if not self.console.is_terminal:
            text = f"[{standing.successes}/{standing.wanted}] seed {meta.seed}: {meta.verdict}"
            self.say(f"{text} at {meta.completion_time:.1f} s; {', '.join(parts)}")
        if not meta.success:
            self.say(f"seed {meta.seed}: {meta.verdict}: {meta.reason}")


def closing(standing: Standing, elapsed: float) -> str:
    """What was done, in a few lines."""
    new = len(standing.lines) - standing.resumed
    lines = [
        f"{standing.successes} of {standing.wanted} successes from {len(standing.lines)} trials"
        + (f", {standing.resumed} of these from before" if standing.resumed else "")
    ]
    if new:
        lines.append(
            f"{new} trials in {format_duration(elapsed)}: "
            f"{standing.simulated:.0f} s of robot time, "
            f"{standing.simulated / elapsed:.2f} x real time together, "
            f"{standing.simulated / standing.busy:.2f} x a worker "
            f"({100 * standing.rendering / standing.busy:.0f} % of its time for pictures)"
        )
    lines += failures([line for line in standing.lines.values() if not line.meta.success])
    return "\n".join(lines)


def failures(lines: list[IndexLine]) -> list[str]:
    """``3 x failure: not within 20 s: ...``, the commonest first."""
    reasons = Counter(f"{line.meta.verdict}: {line.meta.reason}" for line in lines)
    return [f"{number} x {reason}" for reason, number in reasons.most_common()]
