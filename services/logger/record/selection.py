"""Selects the topics to record by patterns."""

from collections.abc import Iterable
from typing import Any

import zenoh

from common.errors import ConfigError
from common.topics import ALL_TOPICS
from common.transport.keys import subscription_of


class Selection:
    """Selects keys by Zenoh key expressions relative to the robot.

    ``*`` stands for one chunk of a key and ``**`` for any number: ``plant/*``, ``camera/**``,
    ``**/state``. Other topics are not subscribed to, so that they cost no bandwidth.
    """

    def __init__(self, robot: str, topics: Iterable[str] = (), exclude: Iterable[str] = ()) -> None:
        """Record what matches one of ``topics`` (empty: everything) and none of ``exclude``.

        Raises:
            ConfigError: a pattern is not a key expression.
        """
        self._robot = robot
        self._topics = [_expression(robot, text) for text in topics]
        self._exclude = [_expression(robot, text) for text in exclude]

    def wants(self, key: str) -> bool:
        """Return whether messages of ``key`` are to be recorded."""
        wanted = zenoh.KeyExpr(key)
        if any(pattern.intersects(wanted) for pattern in self._exclude):
            return False
        return not self._topics or any(pattern.intersects(wanted) for pattern in self._topics)

    def expressions(self, known_keys: Iterable[str] = ()) -> list[str]:
        """Return the key expressions to subscribe to; :meth:`wants` still decides on each key.

        Zenoh cannot subscribe to everything except something. With ``exclude``, the topics of the
        table and ``known_keys``, which services describe, are therefore subscribed to one by one.
        """
        if not self._exclude:
            return [str(pattern) for pattern in self._topics] or [f"{self._robot}/**"]
        table = [subscription_of(self._robot, topic) for topic in ALL_TOPICS]
        return [text for text in (*table, *known_keys) if self._may_want(text)]

    def _may_want(self, text: str) -> bool:
        expression = zenoh.KeyExpr(text)
        if any(pattern.includes(expression) for pattern in self._exclude):
            return False
        return not self._topics or any(pattern.intersects(expression) for pattern in self._topics)


def _expression(robot: str, text: str) -> Any:
    try:
        return zenoh.KeyExpr(f"{robot}/{text}")
    except zenoh.ZError as error:
        raise ConfigError(
            f"{text!r} is not a pattern of topics; expected e.g. plant/*, camera/** or wbc/state"
        ) from error
