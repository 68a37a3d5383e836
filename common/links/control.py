"""Links set while the system runs: the document that every service keeps, and its wire form.

All live changes are one document (:class:`LiveLinks`) with a version. Every service keeps the whole
document, also the links that it does not read, so a change outlives any service as long as one of
them runs: a service that starts asks the others, and the highest version is in force everywhere.
What is set live wins over what was configured.

Each service answers queries on ``<robot>/links/<service>``. A query without a payload changes
nothing; a query with a :class:`LiveLinks` puts that document in force. Both are answered with a
:class:`LinkReply`, or with an error in words. Payloads are msgpack maps.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeVar

import msgpack
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from common.errors import ConfigError, TrillError, explain
from common.links.config import LinkName, Links
from common.links.delay import DelayStats
from common.links.spec import LinkSpec

MAX_BYTES = 1_000_000
"""Longest payload accepted: services read it between two steps of a control loop."""
MAX_NAMES = 256
MAX_TRACED = 60_000
"""Recorded delays of all traces together, so that the document fits into a payload."""


class LinkControlError(TrillError):
    """A live change of links, or the answer to it, is wrong or impossible."""


def _refuse_file(value: object) -> object:
    """Keep a text from the wire from making a service open files."""
    if isinstance(value, str) and value.lstrip().startswith("trace"):
        raise ValueError(
            "a trace file is read where the request is made: send the delays themselves"
        )
    return value


WireSpec = Annotated[LinkSpec, BeforeValidator(_refuse_file)]
Name = Annotated[str, Field(min_length=1, max_length=130)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LiveLinks(_Part):
    """The links set while the system runs.

    Each change is a layer, which wins over those before it. A name that is set again leaves the
    layer it was in, so the document does not grow with the number of changes.
    """

    version: int = Field(
        default=0, ge=0, lt=2**63, description="the highest is in force; 0: nothing was changed"
    )
    replaces: int = Field(
        default=0, ge=0, lt=2**63, description="version from which this one was made"
    )
    cleared: bool = Field(default=False, description="the configured links are switched off")
    layers: tuple[dict[Name, WireSpec], ...] = Field(default=(), max_length=MAX_NAMES)

    @model_validator(mode="after")
    def _check(self) -> Self:
        specs = [spec for layer in self.layers for spec in layer.values()]
        traced = sum(len(spec.trace) for spec in specs)
        if len(specs) > MAX_NAMES or traced > MAX_TRACED:
            raise LinkControlError(
                f"live links: {len(specs)} names with {traced} recorded delays; expected at most "
                f"{MAX_NAMES} and {MAX_TRACED}: clear some first, or use shorter traces"
            )
        for layer in self.layers:
            for name in layer:
                LinkName.parse(name)
        return self

    def with_links(self, links: Mapping[str, LinkSpec], now_ns: int) -> Self:
        """Return the document with one more change; zero delay switches a link off.

        Its version is the wall clock ``now_ns``, or one more than this document's if that is newer.

        Raises:
            ConfigError: a name is unknown.
            LinkControlError: there are too many links, or too many recorded delays.
        """
        kept = (
            {name: spec for name, spec in layer.items() if name not in links}
            for layer in self.layers
        )
        layers = (*(layer for layer in kept if layer), dict(links))
        return type(self)(
            version=max(now_ns, self.version + 1),
            replaces=self.version,
            cleared=self.cleared,
            layers=layers,
        )

    def without_links(self, now_ns: int) -> Self:
        """Return the document that switches every link off, configured ones included."""
        version = max(now_ns, self.version + 1)
        return type(self)(version=version, replaces=self.version, cleared=True)

    def over(self, configured: Links) -> Links:
        """Return the links in force: these laid over what was configured."""
        layers = (
            {LinkName.parse(name): spec for name, spec in layer.items()} for layer in self.layers
        )
        return (Links() if self.cleared else configured).under(Links(tuple(layers)))


class LinkRow(_Part):
    """One input of a service."""

    topic: str
    link: str = Field(default="", description="injected delay as a specification; empty: none")
    delays: DelayStats | None = Field(default=None, description="since the link was set")


class LinkReply(_Part):
    """A service's answer: its inputs, and the live links it knows."""

    service: str
    inputs: list[LinkRow] = Field(default_factory=list)
    live: LiveLinks = LiveLinks()


M = TypeVar("M", bound=_Part)


def to_wire(part: _Part) -> bytes:
    """Encode a document or a reply."""
    packed: bytes = msgpack.packb(part.model_dump(mode="json", exclude_defaults=True))
    return packed


def from_wire(payload: bytes, kind: type[M]) -> M:
    """Decode a document or a reply.

    Raises:
        LinkControlError: the payload is too long, no msgpack map, or a value in it is wrong.
    """
    if len(payload) > MAX_BYTES:
        raise LinkControlError(
            f"{kind.__name__}: expected at most {MAX_BYTES} bytes, got {len(payload)}"
        )
    try:
        values: Any = msgpack.unpackb(payload)
        return kind.model_validate(values)
    except ValidationError as error:
        raise LinkControlError(f"{kind.__name__} is wrong: {explain(error)}") from error
    except ConfigError as error:
        raise LinkControlError(f"{kind.__name__} is wrong: {error}") from error
    except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        raise LinkControlError(
            f"{kind.__name__}: expected a msgpack map, got {len(payload)} bytes that are none "
            f"({error})"
        ) from error
