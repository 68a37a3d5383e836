"""Connect an inbox to a Zenoh session."""

import time
from collections.abc import Callable
from typing import Any

import zenoh

from common.inbox.arrivals import WILDCARD
from common.inbox.inbox import Inbox
from common.schemas import Message
from common.topics import Topic
from common.transport.keys import is_wildcard, subscription_of
from common.transport.session import tag_of, wire_encoding
from common.wire.codec import schema_tag


def subscribe(
    session: "zenoh.Session", robot: str, inbox: Inbox, topics: tuple[Topic[Any], ...]
) -> list[Any]:
    """Subscribe to ``topics`` and feed the inbox; returns the subscribers to keep alive.

    A service does not receive its own messages.
    """
    return [
        session.declare_subscriber(
            subscription_of(robot, topic),
            _receiver(inbox, topic),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        for topic in topics
    ]


def _receiver(inbox: Inbox, topic: Topic[Any]) -> Callable[[Any], None]:
    """Return a callback that passes on payload and arrival time, and does nothing else."""
    schema: type[Message] = topic.schema
    expected = wire_encoding(schema_tag(schema))
    offer, name, fleet, clock = inbox.offer, topic.name, topic.fleet, time.monotonic_ns

    def receive(sample: Any) -> None:
        arrival_ns = clock()
        encoding = sample.encoding
        tag = None if encoding == expected else tag_of(encoding)
        if not fleet and is_wildcard(str(sample.key_expr)):
            tag = WILDCARD
        offer(name, sample.payload.to_bytes(), arrival_ns, tag)

    return receive
