"""The contract between a service and whatever runs it: live, in simulated time, or from a log."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

from common.errors import TrillError
from common.schemas import Message
from common.topics import Topic

M = TypeVar("M", bound=Message)


class Inputs(Protocol):
    """What a service sees of its inputs during one step."""

    def latest(self, topic: Topic[M]) -> M | None:
        """Last good message of a latest-value topic; None before the first."""
        ...

    def updated(self, topic: Topic[Any]) -> bool:
        """Whether a good message arrived since the previous step."""
        ...

    def fresh(self, topic: Topic[Any]) -> bool:
        """Whether the last good message arrived within the topic's ``max_age``."""
        ...

    def age(self, topic: Topic[Any]) -> float:
        """Seconds since the last good message arrived (infinity before the first)."""
        ...

    def events(self, topic: Topic[M]) -> list[M]:
        """Messages of an event topic since the previous step, oldest first."""
        ...


@dataclass(frozen=True)
class Output:
    """One message to publish; the publisher completes its header, keeping ``stamp``."""

    topic: Topic[Any]
    message: Message


class Service(ABC):
    """A service as a plain object; it knows neither the transport nor a wall clock.

    Attributes:
        name: short name, also the ``source`` in message headers.
        period_ns: nominal time between steps [ns].
        reads: topics it subscribes to.
        writes: topics it publishes.
        trigger: optional topic whose arrival starts a step (at most one per ``period_ns``, to
            which the arrivals are phase-locked); without an arrival a step still runs after
            1.5 periods. None: steps are paced by the clock alone.
        exit_code: set by the service itself to end its runner after the current step, whose
            outputs are still published; it becomes the process's exit status. None: run on.
        heartbeat_timeout_s: silence of its loop that others may take for its death [s]; must be
            well above its longest step plus 0.04 s, the time between heartbeats.
        wanted: tells whether anybody reads a topic of ``writes`` just now, to save costly outputs;
            set by the runner. Without one everything is wanted.
        settings: all that :meth:`from_settings` needs to build the like of it, as JSON's types;
            published with its journal so that a log suffices for a replay. Empty: not replayable.
    """

    name: str
    period_ns: int
    reads: tuple[Topic[Any], ...] = ()
    writes: tuple[Topic[Any], ...] = ()
    trigger: Topic[Any] | None = None
    exit_code: int | None = None
    heartbeat_timeout_s: float = 0.1
    wanted: Callable[[Topic[Any]], bool] = staticmethod(lambda _topic: True)
    settings: Mapping[str, Any] = {}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the service as it was, from its :attr:`settings`, to be replayed.

        Raises:
            TrillError: it cannot be built from settings, or these are wrong.
        """
        raise TrillError(f"{cls.__name__} cannot be replayed: not all it heard came over the bus")

    @abstractmethod
    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Advance by one period; ``now_ns`` is the runner's monotonic clock [ns]."""

    def close(self) -> None:
        """Release what the service holds; called once when its runner stops."""
        return
