"""Follows episode marks and keeps the index of episodes."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace

from common.schemas import EpisodeMark
from common.schemas.episode import EpisodeAction
from services.logger.errors import LoggerError

COMPLETE = "complete"
DISCARDED = "discarded"
INTERRUPTED = "interrupted"
OPEN = "open"


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode of a recording; times are arrivals at the logger, monotonic clock [ns].

    ``outcome`` is complete, discarded, interrupted (the next one began, or the recording ended,
    before its end was marked) or open. ``end_ns`` of an open one is 0.
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

    def to_metadata(self) -> dict[str, str]:
        """As an MCAP metadata record."""
        return {name: str(value) for name, value in asdict(self).items()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> "Episode":
        """Inverse of :meth:`to_metadata`.

        Raises:
            LoggerError: the metadata is not that of an episode.
        """
        try:
            return cls(
                episode=int(metadata["episode"]),
                label=metadata["label"],
                start_ns=int(metadata["start_ns"]),
                end_ns=int(metadata["end_ns"]),
                outcome=metadata["outcome"],
            )
        except (KeyError, ValueError) as error:
            raise LoggerError(
                f"an episode record is unreadable: expected number, label, times and outcome, "
                f"got {dict(metadata)}"
            ) from error


class EpisodeBook:
    """Turns marks into episodes; one is open at a time.

    A start while one is open interrupts that one. A mark that repeats (the same start, or an end
    of what is not open) changes nothing.

    Attributes:
        open: the episode that is running.
        finished: all others, in the order of their starts.
        next_number: one more than the highest number seen.
    """

    def __init__(self, open_episode: Episode | None = None, next_number: int = 0) -> None:
        """Start empty, or with an episode left open by an earlier part."""
        self.open = open_episode
        self.finished: list[Episode] = []
        self.next_number = next_number
        if open_episode is not None:
            self.next_number = max(next_number, open_episode.episode + 1)

    def observe(self, mark: EpisodeMark, at_ns: int) -> list[Episode]:
        """Take in a mark that arrived at ``at_ns``; returns the episodes it finished."""
        running = self.open
        self.next_number = max(self.next_number, mark.episode + 1)
        if mark.action is EpisodeAction.START:
            if running is not None and running.episode == mark.episode:
                return []
            done = self.close(at_ns)
            self.open = Episode(mark.episode, mark.label, at_ns)
            return done
        if running is None or running.episode != mark.episode:
            return []
        outcome = COMPLETE if mark.action is EpisodeAction.END else DISCARDED
        return self._finish(replace(running, label=mark.label or running.label), at_ns, outcome)

    def close(self, at_ns: int) -> list[Episode]:
        """The recording ends: an open episode is interrupted, and returned."""
        return [] if self.open is None else self._finish(self.open, at_ns, INTERRUPTED)

    def _finish(self, episode: Episode, at_ns: int, outcome: str) -> list[Episode]:
        done = replace(episode, end_ns=at_ns, outcome=outcome)
        self.open = None
        self.finished.append(done)
        return [done]


def merged(records: Iterable[Episode], marked: Iterable[Episode]) -> list[Episode]:
    """The episodes of a recording from its records and from its marks, in order of start.

    A record stands over what the marks say of the same episode, since marks may be damaged.
    """
    known = {(one.episode, one.start_ns): one for one in marked}
    known |= {(one.episode, one.start_ns): one for one in records}
    return sorted(known.values(), key=lambda one: one.start_ns)
