"""Which links have a delay: names of links, and the layers of a configuration.

A link is a topic on its way to one consumer. A name is ``[service:]topic`` or ``[service:]alias``;
without a service it means every consumer. An alias (:data:`ALIASES`) stands for all links of a
kind. The emergency stop, requests to the plant, the joint command and an operator's claim to the
robot belong to no alias: they are delayed only under their own names.

Two rules choose among several names that cover the same link:

1. the later layer wins: the configuration file, then ``TRILL_LINKS`` (or ``--latency``), then
   ``--link``, then what is set while the system runs;
2. within one layer the more specific name wins: ``service:topic``, ``topic``, ``service:alias``,
   ``alias``; ``camera`` before ``feedback`` before ``both``.
"""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.links.spec import LinkSpec
from common.ports import OPERATORS, PORT_OFFSETS, Role, with_role
from common.topics import (
    ALL_TOPICS,
    CAMERA_LEFT,
    CAMERA_RIGHT,
    PLANT_STATE,
    PLANT_STATUS,
    PLANT_TRUTH,
    TASK_SCENE,
    TASK_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)

LAYERS = ";;"
"""Separates layers in ``TRILL_LINKS``; the later wins."""

CAMERAS = frozenset({CAMERA_LEFT.name, CAMERA_RIGHT.name})
"""Topics of the stereo pair, which are delayed and lost alike."""

_TOPICS = frozenset(topic.name for topic in ALL_TOPICS)
_OBSERVED = (
    PLANT_STATE,
    PLANT_TRUTH,
    PLANT_STATUS,
    TASK_SCENE,
    TASK_STATUS,
    WBC_STATE,
    WBC_REPLY,
    WBC_AUTHORITY,
    WBC_TARGET,
)
_CAMERA = frozenset(("", name) for name in CAMERAS)
_COMMAND = frozenset(
    (controller, topic.name)
    for controller in with_role(Role.CONTROLLER)
    for topic in (TELEOP_SETPOINT, TELEOP_GAIT)
)
_FEEDBACK = _CAMERA | {(operator, topic.name) for operator in OPERATORS for topic in _OBSERVED}


class Alias(NamedTuple):
    """A short name for several links (consumer, topic); an empty consumer stands for every one."""

    description: str
    links: frozenset[tuple[str, str]]


ALIASES: Mapping[str, Alias] = {
    "command": Alias(
        "operator or policy → robot: set-points and gait requests, at the controller",
        _COMMAND,
    ),
    "camera": Alias("both cameras, delayed and lost alike, for every consumer", _CAMERA),
    "feedback": Alias(
        "robot → operator: the cameras, and the state, status and replies an operator reads",
        _FEEDBACK,
    ),
    "both": Alias("command and feedback", _COMMAND | _FEEDBACK),
}


@dataclass(frozen=True)
class LinkName:
    """The name of one or several links.

    Attributes:
        text: the name as written.
        service: the only consumer that is meant; empty: every one.
        target: a topic or an alias.
    """

    text: str
    service: str
    target: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``[service:]topic`` or ``[service:]alias``.

        Which services exist only the running system knows; :meth:`Links.from_table` checks them.

        Raises:
            ConfigError: there is no such topic or alias, or the service is empty.
        """
        service, separator, target = text.strip().rpartition(":")
        if separator and not service:
            raise ConfigError(f"link {text!r}: expected a service before ':', got ''")
        if target not in _TOPICS and target not in ALIASES:
            raise ConfigError(
                f"link {text!r}: no topic {target!r}; expected '[service:]topic' with one of "
                f"{', '.join(ALIASES)}, {', '.join(sorted(_TOPICS))}"
            )
        return cls(text.strip(), service, target)

    def covers(self, service: str, topic: str) -> bool:
        """Return whether the link of ``topic`` towards ``service`` is meant."""
        if self.service and self.service != service:
            return False
        if self.target not in ALIASES:
            return topic == self.target
        links = ALIASES[self.target].links
        return (service, topic) in links or ("", topic) in links

    @property
    def rank(self) -> tuple[bool, bool, int]:
        """How specific the name is: topic before alias, one consumer before all, fewest links."""
        alias = ALIASES.get(self.target)
        return alias is None, bool(self.service), 0 if alias is None else -len(alias.links)


@dataclass(frozen=True)
class Links:
    """Delays by name, in layers of which a later one wins over the earlier."""

    layers: tuple[Mapping[LinkName, LinkSpec], ...] = ()

    @classmethod
    def from_table(cls, table: Mapping[str, Any], also: Iterable[str] = ()) -> Self:
        """Make one layer of a mapping of names to specifications (string, table or object).

        It may name the services of :data:`~common.ports.PORT_OFFSETS` and those in ``also``.

        Raises:
            ConfigError: a name is unknown or a specification is wrong.
        """
        services = {*PORT_OFFSETS, *also}
        layer = {LinkName.parse(key): checked_spec(key, value) for key, value in table.items()}
        for name in layer:
            if name.service and name.service not in services:
                raise ConfigError(
                    f"link {name.text!r}: no service {name.service!r}; expected one of "
                    f"{', '.join(sorted(services))}"
                )
        return cls((layer,) if layer else ())

    @classmethod
    def from_variable(cls, text: str, also: Iterable[str] = ()) -> Self:
        """Read ``name=spec; name=spec``; parts separated by ``;;`` are layers.

        Raises:
            ConfigError: a part is not understood, a name unknown or a specification wrong.
        """
        links = cls()
        for source in text.split(LAYERS):
            parts = [part for part in source.split(";") if part.strip()]
            links = links.under(cls.from_table(parse_link_options(parts), also))
        return links

    def under(self, later: "Links") -> Self:
        """Return these links with those of ``later`` laid over them."""
        return type(self)((*self.layers, *later.layers))

    def of(self, service: str, topic: str) -> LinkSpec | None:
        """Return the delay on ``topic`` towards ``service``; None if no name covers it."""
        for layer in reversed(self.layers):
            names = [name for name in layer if name.covers(service, topic)]
            if names:
                return layer[max(names, key=lambda name: name.rank)]
        return None


def checked_spec(name: str, value: Any) -> LinkSpec:
    """Read a specification (string, table or object) for the link ``name``.

    Raises:
        ConfigError: the specification is wrong.
    """
    try:
        return LinkSpec.model_validate(value)
    except ValidationError as error:
        raise ConfigError(f"link {name!r} is wrong: {explain(error)}") from error
    except ConfigError as error:
        raise ConfigError(f"link {name!r} is wrong: {error}") from error


def parse_link_options(options: Iterable[str]) -> dict[str, str]:
    """Split ``name=spec`` texts.

    Raises:
        ConfigError: a text has no ``=``.
    """
    table = {}
    for option in options:
        key, separator, spec = option.partition("=")
        if not separator or not key.strip():
            raise ConfigError(
                f"link {option!r} not understood; expected '[service:]topic=spec' or "
                "'command=spec' (camera, feedback, both)"
            )
        table[key.strip()] = spec.strip()
    return table


def link_seed(seed: int, service: str, topic: str) -> int:
    """Derive a link's own seed from the run's, so that two links of one run do not jitter alike.

    The stereo pair is one link and shares a seed.
    """
    family = "camera" if topic in CAMERAS else topic
    return zlib.crc32(f"{seed} {service} {family}".encode())
