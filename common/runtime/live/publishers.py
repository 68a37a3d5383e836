"""Publish the messages of a live service and its runner."""

import logging
from collections.abc import Iterable, Sequence
from typing import Any

from common.errors import SchemaError, TrillError
from common.runtime.service import Output
from common.schemas import Message, OutputHealth
from common.topics import Topic
from common.transport.publisher import Publisher

_log = logging.getLogger(__name__)


class PublisherSet:
    """One publisher for each topic that a service and its runner write."""

    def __init__(
        self,
        session: Any,
        robot: str,
        service: str,
        boot: int,
        *,
        writes: Iterable[Topic[Any]],
        own: Iterable[Topic[Any]],
    ) -> None:
        """Declare publishers for ``writes``, the service's topics, and ``own``, its runner's."""
        self._service = service
        self._writes = frozenset(topic.name for topic in writes)
        self._publishers: dict[str, Publisher[Any]] = {
            topic.name: Publisher(session, robot, topic, service, boot)
            for topic in {topic.name: topic for topic in (*writes, *own)}.values()
        }

    def publish(self, outputs: Sequence[Output], captured_ns: int) -> None:
        """Send the outputs of a step.

        Args:
            outputs: of the service's own topics.
            captured_ns: start of the step, for headers without a time of capture.

        Raises:
            TrillError: a topic is not among the service's ``writes``.
            SchemaError: a message does not fit the wire.
        """
        for output in outputs:
            if output.topic.name not in self._writes:
                raise TrillError(
                    f"{self._service} published {output.topic.name!r}; expected one of its "
                    f"`writes`: {', '.join(sorted(self._writes)) or 'none'}"
                )
            self._publishers[output.topic.name].send(output.message, captured_ns)

    def send(self, topic: Topic[Any], message: Message) -> None:
        """Send a message of the runner; one that does not fit the wire is logged, not raised."""
        try:
            self._publishers[topic.name].send(message)
        except SchemaError:
            _log.exception("%s cannot send %s", self._service, topic.name)

    def wanted(self, topic: Topic[Any]) -> bool:
        """Whether another session subscribes to a topic just now."""
        return self._publishers[topic.name].wanted

    def health(self) -> list[OutputHealth]:
        """Return what was sent so far, by topic."""
        return [
            OutputHealth(topic=name, sent=publisher.sent, errors=publisher.errors)
            for name, publisher in self._publishers.items()
        ]
