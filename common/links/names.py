"""Names under which links are set: a topic, a topic of one consumer, or a short name for several.

A short name stands for every link of a kind, with the right consumers:

- ``command``: operator or policy → robot: set-points and gait requests as the controller reads
  them.
- ``camera``: both eyes, for every consumer.
- ``feedback``: robot → operator: both eyes, and what an operator, policy or bridge reads of the
  plant, its scene and the controller.
- ``both``: ``command`` and ``feedback``.

The emergency stop, requests to the plant and the joint command are in none of them: they are
delayed only under their own names.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from common.errors import ConfigError
from common.ports import OPERATORS, PORT_OFFSETS, Role, with_role
from common.topics import (
    ALL_TOPICS,
    CAMERA_LEFT,
    CAMERA_RIGHT,
    PLANT_STATE,
    PLANT_STATUS,
    TASK_SCENE,
    TASK_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_REPLY,
    WBC_STATE,
)

(CONTROLLER,) = with_role(Role.CONTROLLER)

EYES = frozenset({CAMERA_LEFT.name, CAMERA_RIGHT.name})
"""Topics that are one link of two halves."""

_TOPICS = frozenset(topic.name for topic in ALL_TOPICS)
_COMMAND = frozenset({TELEOP_SETPOINT.name, TELEOP_GAIT.name})
_OBSERVED = frozenset(
    topic.name
    for topic in (PLANT_STATE, PLANT_STATUS, TASK_SCENE, TASK_STATUS, WBC_STATE, WBC_REPLY)
)

_DEPTHS = {"both": 0, "feedback": 1, "camera": 2, "command": 2}
"""Short names, the wider the lower."""

ALIASES: Mapping[str, str] = {
    "command": "operator or policy → robot: set-points and gait requests, at the controller",
    "camera": "both eyes, delayed and lost alike, for every consumer",
    "feedback": "robot → operator: the eyes, and the state, status and replies an operator reads",
    "both": "command and feedback",
}
"""Short names in words, for help."""


@dataclass(frozen=True)
class LinkName:
    """A checked name of one or several links.

    Attributes:
        text: as written.
        target: topic or short name.
        service: its only consumer; empty: every one.
    """

    text: str
    target: str
    service: str = ""

    def covers(self, service: str, topic: str) -> bool:
        """Whether the link of ``topic`` towards ``service`` is meant."""
        if self.service and self.service != service:
            return False
        if self.target in _TOPICS:
            return topic == self.target
        return _in_alias(self.target, service, topic)

    @property
    def rank(self) -> tuple[bool, bool, int]:
        """The greater, the more specific: topic before short name, one consumer before all."""
        is_topic = self.target in _TOPICS
        return is_topic, bool(self.service), 0 if is_topic else _DEPTHS[self.target]


def parse_name(text: str, also: Iterable[str] = ()) -> LinkName:
    """Check ``[service:]topic`` or ``[service:]short-name``.

    Args:
        text: the name.
        also: services that may be named though :data:`~common.ports.PORT_OFFSETS` does not.

    Raises:
        ConfigError: there is no such service, topic or short name.
    """
    service, separator, target = text.strip().rpartition(":")
    services = {*PORT_OFFSETS, *also}
    if separator and service not in services:
        raise ConfigError(
            f"link {text!r}: no service {service!r}; expected one of {', '.join(sorted(services))}"
        )
    if target not in _TOPICS and target not in ALIASES:
        raise ConfigError(
            f"link {text!r}: no topic {target!r}; expected '[service:]topic' with one of "
            f"{', '.join(ALIASES)}, {', '.join(sorted(_TOPICS))}"
        )
    return LinkName(text.strip(), target, service)


def family_of(topic: str) -> str:
    """The name that seeds a link: the same for both eyes, which share one fate."""
    return "camera" if topic in EYES else topic


def alias_help() -> str:
    """The short names as indented lines, for ``--help``."""
    return "\n".join(f"  {name:<10} {text}" for name, text in ALIASES.items())


def _in_alias(alias: str, service: str, topic: str) -> bool:
    if alias == "command":
        return service == CONTROLLER and topic in _COMMAND
    if alias == "camera":
        return topic in EYES
    if alias == "feedback":
        return topic in EYES or (service in OPERATORS and topic in _OBSERVED)
    return any(_in_alias(part, service, topic) for part in ("command", "feedback"))
