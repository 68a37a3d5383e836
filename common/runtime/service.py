"""Define the contract between a service and its runner: live, in simulated time, or from a log."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

from common.errors import TrillError
from common.schemas import Message, Sender
from common.topics import Topic

M = TypeVar("M", bound=Message)


class Inputs(Protocol):
    """What a service sees of its inputs during one step."""

    def latest(self, topic: Topic[M]) -> M | None:
        """Last good message of a latest-value topic; None before the first."""
        ...

    def latest_by_sender(self, topic: Topic[M]) -> dict[Sender, M]:
        """Last good message of a latest-value topic from each sender, most recent last."""
        ...

    def history(self, topic: Topic[M], seconds: float) -> list[M]:
        """Good messages that arrived up to ``seconds`` before the newest, oldest first.

        They are kept from the first call on.
        """
        ...

    def latest_pair(self, left: Topic[M], right: Topic[M]) -> tuple[M, M] | None:
        """Newest messages of two topics with the same ``stamp``; None if there are none."""
        ...

    def updated(self, topic: Topic[Any]) -> bool:
        """Whether a good message arrived since the previous step."""
        ...

    def fresh(self, topic: Topic[Any]) -> bool:
        """Whether the last good message arrived within the topic's largest age.

        That is the table's ``max_age``, or ``[runtime] max_age`` of the configuration.
        """
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
    """A service as a plain object, independent of the transport and of wall clocks.

    Attributes:
        name: short name, also the ``source`` in message headers.
        period_ns: nominal time between steps [ns].
        reads: topics it subscribes to.
        writes: topics it publishes.
        trigger: topic whose arrivals start steps (at most one per ``period_ns``, phase-locked to
            the arrivals); without an arrival a step still runs after 1.5 periods. None: steps are
            paced by the clock alone.
        exit_code: set by the service itself to end its runner after the current step, whose
            outputs are still published; it becomes the process's exit status. None: keep running.
        heartbeat_timeout_s: heartbeat timeout of its loop [s]; must be well above its longest step
            plus 0.04 s, the time between heartbeats.
        boot: random id of this run of the service, as in the headers of its messages; set by the
            runner before the first step.
        wanted: returns whether a topic of ``writes`` has a subscriber just now, to save costly
            outputs; set by the runner. Without a runner every topic is wanted.
        settings: JSON-serialisable constructor arguments, used by :meth:`from_settings` to rebuild
            the service for a replay; published with its journal. Empty: not replayable.
    """

    name: str
    period_ns: int
    reads: tuple[Topic[Any], ...] = ()
    writes: tuple[Topic[Any], ...] = ()
    trigger: Topic[Any] | None = None
    exit_code: int | None = None
    heartbeat_timeout_s: float = 0.1
    boot: int = 0
    wanted: Callable[[Topic[Any]], bool] = staticmethod(lambda _topic: True)
    settings: Mapping[str, Any] = {}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild a service from its :attr:`settings`, to be replayed.

        Raises:
            TrillError: it has inputs outside the bus, so that a log cannot reproduce it, or the
                settings are wrong.
        """
        raise TrillError(f"{cls.__name__} cannot be replayed: it has inputs outside the bus")

    @abstractmethod
    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Advance by one period; ``now_ns`` is the runner's monotonic clock [ns]."""

    def step_until(
        self, inputs: Inputs, now_ns: int, until_ns: int
    ) -> tuple[int, Sequence[Output]]:
        """Step at ``now_ns`` and perhaps go on, a period at a time, up to the first output.

        A runner in simulated time calls it where no input comes meanwhile. A service whose steps
        are cheaper together does several; what it does and when must be the same as step by step.

        Args:
            inputs: of the first step; the others have none.
            now_ns: the runner's clock at the first step [ns].
            until_ns: every step is before this time, except the first [ns].

        Returns:
            time of the last step [ns] and its outputs; the steps before it have none.
        """
        return now_ns, self.step(inputs, now_ns)

    def after_step(self) -> None:
        """Do what the outputs of a step need not wait for; called when they have been sent."""
        return

    def close(self) -> None:
        """Release resources; called once when the runner stops."""
        return
