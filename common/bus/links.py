"""Which links have a delay: topic × consumer, from a table, a variable or options."""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from pydantic import ValidationError

from common.bus.linkspec import LinkSpec
from common.errors import ConfigError
from common.topics import ALL_TOPICS


@dataclass(frozen=True)
class Links:
    """Delays by topic name, for every consumer or, as ``service:topic``, for one."""

    table: Mapping[str, LinkSpec] = field(default_factory=dict)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Check a mapping of ``[service:]topic`` to a specification (string, table or object).

        Raises:
            ConfigError: a topic is unknown or a specification is wrong.
        """
        known = {topic.name for topic in ALL_TOPICS}
        specs = {}
        for key, value in table.items():
            topic = key.rpartition(":")[2]
            if topic not in known:
                raise ConfigError(
                    f"link {key!r}: no topic {topic!r}; expected '[service:]topic' with one of "
                    f"{', '.join(sorted(known))}"
                )
            try:
                specs[key] = LinkSpec.model_validate(value)
            except ValidationError as error:
                raise ConfigError(f"link {key!r} is wrong: {error}") from error
        return cls(specs)

    def merged(self, *others: Mapping[str, Any]) -> "Links":
        """Return these links with ``others`` over them; the last one wins."""
        table: dict[str, Any] = dict(self.table)
        for other in others:
            table |= other
        return Links.from_table(table)

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
