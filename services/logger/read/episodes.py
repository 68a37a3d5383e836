"""Derives the episodes of a recording from its episode marks."""

from dataclasses import dataclass, replace

from common.schemas import EpisodeMark
from common.schemas.episode import EpisodeAction

COMPLETE = "complete"
DISCARDED = "discarded"
INTERRUPTED = "interrupted"
OPEN = "open"


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode of a recording.

    Attributes:
        episode: its number.
        label: task, condition or remark of its marks.
        start_ns: arrival of its start mark at the logger, monotonic clock [ns].
        end_ns: arrival of its end mark, or when it was interrupted [ns]; 0 while it is open.
        outcome: complete, discarded, interrupted (the next episode began or the recording ended
            before its end was marked) or open.
    """

    episode: int
    label: str
    start_ns: int
    end_ns: int = 0
    outcome: str = OPEN

    @property
    def seconds(self) -> float:
        """Length [s]; 0 while open."""
        return 1e-9 * max(0, self.end_ns - self.start_ns)


class EpisodeBook:
    """Turns marks into episodes; one is open at a time.

    A start while one is open interrupts that one. A repeated mark (the same start, or an end of
    an episode that is not open) changes nothing.

    Attributes:
        open: the episode that is running.
        finished: all others, in the order of their starts.
        next_number: one more than the highest number seen.
    """

    def __init__(self, next_number: int = 0) -> None:
        """Start without episodes; earlier recordings used the numbers below ``next_number``."""
        self.open: Episode | None = None
        self.finished: list[Episode] = []
        self.next_number = next_number

    def observe(self, mark: EpisodeMark, at_ns: int) -> None:
        """Take in a mark that arrived at ``at_ns``."""
        running = self.open
        self.next_number = max(self.next_number, mark.episode + 1)
        is_running = running is not None and running.episode == mark.episode
        if mark.action is EpisodeAction.START:
            if not is_running:
                self.close(at_ns)
                self.open = Episode(mark.episode, mark.label, at_ns)
        elif running is not None and is_running:
            outcome = COMPLETE if mark.action is EpisodeAction.END else DISCARDED
            self._finish(replace(running, label=mark.label or running.label), at_ns, outcome)

    def close(self, at_ns: int) -> None:
        """End the recording at ``at_ns``, which interrupts an open episode."""
        if self.open is not None:
            self._finish(self.open, at_ns, INTERRUPTED)

    def _finish(self, episode: Episode, at_ns: int, outcome: str) -> None:
        self.finished.append(replace(episode, end_ns=at_ns, outcome=outcome))
        self.open = None
