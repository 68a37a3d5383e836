"""Which topics are recorded."""

from collections.abc import Iterable
from typing import Any

import zenoh

from common.errors import ConfigError
from common.topics import ALL_TOPICS
from common.transport.keys import subscription_of


class Selection:
    """Chooses keys by patterns relative to the robot, in Zenoh's language.

    ``*`` stands for one part of a key and ``**`` for any number: ``plant/*``, ``camera/**``,
    ``**/state``. What is not wanted is not even subscribed to, so that it costs no bandwidth.
    """

    def __init__(self, robot: str, topics: Iterable[str] = (), exclude: Iterable[str] = ()) -> None:
        """Record what matches one of ``topics`` (none: everything) and none of ``exclude``.

        Raises:
            ConfigError: a pattern is not one.
        """
        self._robot = robot
        self._topics = [_expression(robot, text) for text in topics]
        self._exclude = [_expression(robot, text) for text in exclude]

    def wants(self, key: str) -> bool:
        """Whether messages of ``key`` are to be recorded."""
        wanted = zenoh.KeyExpr(key)
        if any(pattern.intersects(wanted) for pattern in self._exclude):
            return False
        return not self._topics or any(pattern.intersects(wanted) for pattern in self._topics)

    def expressions(self, known_keys: Iterable[str] = ()) -> list[str]:
        """Key expressions to subscribe to; what they match is still to be asked :meth:`wants`.

        There is no "all but" on the wire. With something excluded, the topics of the table and
        ``known_keys``, those that services say they have, are therefore subscribed to one by one.
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
            f"{text!r} is not a pattern of topics; expected for instance plant/*, camera/** or "
            "wbc/state"
        ) from error
