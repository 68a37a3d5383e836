"""Inputs of a service under the test's control."""

from typing import Any, TypeVar

from common.runtime.service import Inputs
from common.schemas import Message, Sender
from common.topics import Topic

M = TypeVar("M", bound=Message)


class FakeInputs(Inputs):
    """Inputs set by hand; call :meth:`begin_step` before putting what one step shall see.

    Attributes:
        messages: the last message by topic name.
        ages: age by topic name [s].
        queues: messages of the present step by topic name.
        stale: names of topics that are not fresh, whatever their age.
    """

    def __init__(self) -> None:
        self.messages: dict[str, Any] = {}
        self.ages: dict[str, float] = {}
        self.queues: dict[str, list[Any]] = {}
        self.stale: set[str] = set()
        self._senders: dict[str, dict[Sender, Any]] = {}
        self._history: dict[str, list[Any]] = {}

    def begin_step(self) -> None:
        """Forget what was new."""
        self.queues.clear()

    def put(self, topic: Topic[Any], message: Message, age: float = 0.0) -> None:
        """Have a message arrive that is ``age`` seconds old."""
        self.messages[topic.name] = message
        self.ages[topic.name] = age
        self.queues.setdefault(topic.name, []).append(message)
        self._senders.setdefault(topic.name, {})[message.header.sender] = message
        self._history.setdefault(topic.name, []).append(message)

    def latest(self, topic: Topic[Any]) -> Any:
        return self.messages.get(topic.name)

    def latest_by_sender(self, topic: Topic[M]) -> dict[Sender, M]:
        return dict(self._senders.get(topic.name, {}))

    def history(self, topic: Topic[M], seconds: float) -> list[M]:
        """Everything, whatever the time."""
        return list(self._history.get(topic.name, []))

    def latest_pair(self, left: Topic[M], right: Topic[M]) -> tuple[M, M] | None:
        pair = self.latest(left), self.latest(right)
        same = None not in pair and pair[0].header.stamp == pair[1].header.stamp
        return pair if same else None

    def updated(self, topic: Topic[Any]) -> bool:
        return topic.name in self.queues

    def fresh(self, topic: Topic[Any]) -> bool:
        return topic.name not in self.stale and self.age(topic) <= topic.max_age

    def age(self, topic: Topic[Any]) -> float:
        return self.ages.get(topic.name, float("inf"))

    def events(self, topic: Topic[M]) -> list[M]:
        return list(self.queues.get(topic.name, []))
