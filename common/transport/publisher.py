"""Publish typed messages: stamp the header, encode, and pass to the transport."""

import logging
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import zenoh

from common.schemas import Message
from common.topics import Priority, Topic
from common.transport.keys import key_of
from common.transport.session import wire_encoding
from common.wire.codec import encode_body, schema_tag, with_header
from common.wire.stamper import HeaderStamper

M = TypeVar("M", bound=Message)

PRIORITIES = {
    Priority.CONTROL: zenoh.Priority.REAL_TIME,
    Priority.INTERACTIVE: zenoh.Priority.INTERACTIVE_HIGH,
    Priority.BULK: zenoh.Priority.DATA_LOW,
}
"""The transport's class of each priority."""
_LOG_INTERVAL_S = 1.0

_log = logging.getLogger(__name__)


class Publisher(Generic[M]):
    """Publishes one topic from one source.

    Everything is sent so that a subscriber that does not read never stops the sender: congestion
    drops after a short wait (see :class:`~common.transport.config.BusConfig`). Events travel with
    the same reliable, ordered transport; a message is lost only when a link's queue stays full.
    """

    def __init__(
        self,
        session: "zenoh.Session",
        robot: str,
        topic: Topic[M],
        source: str,
        boot: int,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Declare the publisher of ``topic`` by the service ``source``.

        ``robot`` is the first part of the key, ``boot`` the random id of this process, and
        ``clock`` returns the time of sending [ns].
        """
        self.topic = topic
        self.sent = 0
        """Messages that the transport accepted."""
        self.errors = 0
        """Messages the transport refused."""
        self._clock = clock
        self._stamper = HeaderStamper(source, boot, clock)
        self._logged_at = -_LOG_INTERVAL_S
        encoding = wire_encoding(schema_tag(topic.schema))
        self._publisher: Any = session.declare_publisher(
            key_of(robot, topic, source),
            encoding=encoding,
            priority=PRIORITIES[topic.priority],
            express=topic.priority is not Priority.BULK,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def send(self, message: M, captured_ns: int = 0) -> bool:
        """Stamp, encode and send; returns whether the transport accepted it.

        Errors of the transport are counted and logged, not raised.

        Args:
            message: to be sent.
            captured_ns: when its information was captured, unless its header says so [ns].

        Raises:
            SchemaError: the message does not fit the wire.
        """
        started = self._clock()
        body = encode_body(message)
        payload = with_header(message, body, self._stamper.next(message, captured_ns, started))
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            self._count_error(error)
            return False
        self.sent += 1
        return True

    @property
    def wanted(self) -> bool:
        """Whether another session subscribes to the topic now, as far as this one knows."""
        return bool(self._publisher.matching_status.matching)

    def close(self) -> None:
        """Withdraw the publisher."""
        self._publisher.undeclare()

    def _count_error(self, error: Any) -> None:
        self.errors += 1
        now = time.monotonic()
        if now - self._logged_at >= _LOG_INTERVAL_S:
            self._logged_at = now
            _log.warning("cannot send %s (%d so far): %s", self.topic.name, self.errors, error)
