"""Which links have a delay: from a configuration file, a variable or options.

Names are those of :mod:`common.links.names`. Who wins where several cover the same link:

1. the later source: file, then ``TRILL_LINKS`` (or ``--latency``), then ``--link``, then what is
   set while the system runs;
2. within one source the more specific name: ``service:topic``, ``topic``, ``service:short-name``,
   short name; ``camera`` before ``feedback`` before ``both``.
"""

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.links.names import LinkName, family_of, parse_name
from common.links.spec import LinkSpec

LAYERS = ";;"
"""Separates sources in ``TRILL_LINKS``; the later wins."""

Layer = Mapping[LinkName, LinkSpec]


@dataclass(frozen=True)
class Links:
    """Delays by name, in layers of which a later one wins over the earlier."""

    layers: tuple[Layer, ...] = ()

    @classmethod
    def from_table(cls, table: Mapping[str, Any], also: Iterable[str] = ()) -> Self:
        """Check a mapping of names to specifications (string, table or object): one layer.

        Args:
            table: the links.
            also: services that may be named though
                :data:`~common.transport.config.PORT_OFFSETS` does not name them.

        Raises:
            ConfigError: a name is unknown or a specification is wrong.
        """
        also = tuple(also)
        layer = {parse_name(key, also): checked_spec(key, value) for key, value in table.items()}
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
        """These links where ``later`` says nothing."""
        return type(self)((*self.layers, *later.layers))

    @property
    def table(self) -> dict[str, LinkSpec]:
        """Every entry by its name, of all layers."""
        return {name.text: spec for layer in self.layers for name, spec in layer.items()}

    def of(self, service: str, topic: str) -> LinkSpec | None:
        """The delay on ``topic`` towards ``service``; None if there is none."""
        for layer in reversed(self.layers):
            meant = [name for name in layer if name.covers(service, topic)]
            if meant:
                return layer[max(meant, key=lambda name: name.rank)]
        return None


def checked_spec(name: str, value: Any) -> LinkSpec:
    """Read a specification (string, table or object) for the link ``name``.

    Raises:
        ConfigError: it is wrong.
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
    """Derive a link's own seed, so that two links of one run do not jitter alike.

    The two eyes are halves of one link and have the same.
    """
    return zlib.crc32(f"{seed} {service} {family_of(topic)}".encode())
