"""Build and read the keys of topics: ``<robot>/<topic>``, or ``<robot>/<topic>/<source>``."""

from collections.abc import Mapping
from typing import Any

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
