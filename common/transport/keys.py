"""Build and read the keys of topics: ``<robot>/<topic>``, or ``<robot>/<topic>/<source>``."""

from collections.abc import Mapping
from typing import Any

import zenoh

from common.topics import ALL_TOPICS, Topic

_BY_NAME: Mapping[str, Topic[Any]] = {topic.name: topic for topic in ALL_TOPICS}


def key_of(robot: str, topic: Topic[Any], source: str) -> str:
    """Return the key under which ``source`` publishes ``topic``."""
    return f"{robot}/{topic.name}/{source}" if topic.per_source else f"{robot}/{topic.name}"


def subscription_of(robot: str, topic: Topic[Any]) -> str:
    """Return the key expression that matches ``topic`` from every source."""
    return f"{robot}/{topic.name}/*" if topic.per_source else f"{robot}/{topic.name}"


def topic_of(robot: str, key: str) -> Topic[Any] | None:
    """Return the topic published under ``key``; None if the table has none."""
    prefix = f"{robot}/"
    if not key.startswith(prefix):
        return None
    name = key[len(prefix) :]
    topic = _BY_NAME.get(name)
    if topic is not None and not topic.per_source:
        return topic
    parent = _BY_NAME.get(name.rpartition("/")[0])
    return parent if parent is not None and parent.per_source else None


def is_wildcard(key: str) -> bool:
    """Whether a sample's key is an expression: that of a put on many keys at once."""
    return "*" in key


def received_as(robot: str, key: str) -> str | None:
    """Return the key under which a sample counts for ``robot``; None if it is to be refused.

    The sample of a put on a wildcard key carries the wildcard. Such a put is taken for the topic
    that may be sent to many robots at once, and for no other.
    """
    if not is_wildcard(key):
        return key
    put = zenoh.KeyExpr(key)
    own = (subscription_of(robot, topic) for topic in ALL_TOPICS if topic.fleet)
    return next((each for each in own if put.intersects(zenoh.KeyExpr(each))), None)
