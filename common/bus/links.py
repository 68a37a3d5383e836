"""Which links have a delay: topic × consumer, from a table, a variable or options."""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from pydantic import ValidationError

from common.bus.config import PORT_OFFSETS
from common.bus.linkspec import LinkSpec
from common.errors import ConfigError, explain
from common.topics import ALL_TOPICS


@dataclass(frozen=True)
class Links:
    """Delays by topic name, for every consumer or, as ``service:topic``, for one."""

    table: Mapping[str, LinkSpec] = field(default_factory=dict)

    @classmethod
    def from_table(cls, table: Mapping[str, Any], also: Iterable[str] = ()) -> Self:
        """Check a mapping of ``[service:]topic`` to a specification (string, table or object).

        Args:
            table: the links.
            also: services that may be named though
                :data:`~common.bus.config.PORT_OFFSETS` does not name them.

        Raises:
            ConfigError: a service or topic is unknown or a specification is wrong.
        """
        services = {*PORT_OFFSETS, *also}
        known = {topic.name for topic in ALL_TOPICS}
        specs = {}
        for key, value in table.items():
            service, separator, topic = key.rpartition(":")
            if separator and service not in services:
                raise ConfigError(
                    f"link {key!r}: no service {service!r}; expected one of "
                    f"{', '.join(sorted(services))}"
                )
            if topic not in known:
                raise ConfigError(
                    f"link {key!r}: no topic {topic!r}; expected '[service:]topic' with one of "
                    f"{', '.join(sorted(known))}"
                )
            try:
                specs[key] = LinkSpec.model_validate(value)
            except ValidationError as error:
                raise ConfigError(f"link {key!r} is wrong: {explain(error)}") from error
            except ConfigError as error:
                raise ConfigError(f"link {key!r} is wrong: {error}") from error
        return cls(specs)

    def of(self, service: str, topic: str) -> LinkSpec | None:
        """The delay on ``topic`` towards ``service``; None if there is none."""
        return self.table.get(f"{service}:{topic}", self.table.get(topic))


def parse_link_options(options: Iterable[str]) -> dict[str, str]:
    """Split ``[service:]topic=spec`` texts.

    Raises:
        ConfigError: a text has no ``=``.
    """
    table = {}
    for option in options:
        key, separator, spec = option.partition("=")
        if not separator or not key.strip():
            raise ConfigError(f"link {option!r} not understood; expected '[service:]topic=spec'")
        table[key.strip()] = spec.strip()
    return table


def link_seed(seed: int, service: str, topic: str) -> int:
    """Derive a link's own seed, so that two links of one run do not jitter alike."""
    return zlib.crc32(f"{seed} {service} {topic}".encode())
