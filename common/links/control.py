"""Links changed while the system runs: what is asked and answered, and what follows from it.

Each service answers on ``<robot>/links/<service>``. Request and reply are msgpack maps
(:class:`LinkRequest`, :class:`LinkReply`); what cannot be done is answered with an error in words.

Every service keeps the whole table of live changes, also of links it does not read, each entry
with a version: wall-clock nanoseconds, or one more than the newest known if that is greater. A
service that starts asks the others and takes over what is newer, so a change outlives any service
but not all of them. On one input the entry of the highest version decides, and what is live wins
over what was configured.
"""

from collections.abc import Iterable
from typing import Annotated, Any, Literal, TypeVar

import msgpack
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from common.errors import ConfigError, TrillError, explain
from common.links.config import Links
from common.links.names import LinkName, parse_name
from common.links.spec import LinkSpec

EVERYTHING = "*"
"""Name of the entry that clears every link."""
MAX_BYTES = 200_000
"""Longest request taken: it is read between two steps of a control loop."""
MAX_REPLY_BYTES = 1_000_000
"""Longest reply taken: it tells of all changes, and is read by those who start or ask."""
MAX_ENTRIES = 256
MAX_TRACED = 60_000
"""Delays of all traces together, so that a reply can tell them."""


class LinkControlError(TrillError):
    """A request to change links, or an answer, is not one."""


def links_key(robot: str, service: str) -> str:
    """Key on which ``service`` answers; ``*`` for all."""
    return f"{robot}/links/{service}"


def _no_file(value: object) -> object:
    """A text from the wire must not make a service open files."""
    if isinstance(value, str) and value.lstrip().startswith("trace"):
        raise ValueError(
            "a trace file is read where the request is made: send the delays themselves"
        )
    return value


WireSpec = Annotated[LinkSpec, BeforeValidator(_no_file)]
Name = Annotated[str, Field(min_length=1, max_length=130)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LinkRequest(_Part):
    """What to do.

    ``list`` changes nothing; ``peers`` neither, and is answered without figures; ``set`` puts what
    ``links`` says on each name's links, None nothing; ``clear`` takes every delay away.
    """

    action: Literal["list", "peers", "set", "clear"]
    links: dict[Name, WireSpec | None] = Field(default_factory=dict, max_length=64)
    version: int | None = Field(
        default=None, ge=0, lt=2**63, description="greater than of any change before; None: chosen"
    )


class LinkEntry(_Part):
    """One live change."""

    name: Name
    spec: WireSpec | None
    version: int = Field(ge=0, lt=2**63)


class LinkRow(_Part):
    """One input of a service; durations in seconds."""

    topic: str
    link: str = Field(description="what is injected; empty: nothing")
    requested_mean: float = 0.0
    requested_p99: float = 0.0
    achieved_mean: float = 0.0
    achieved_p99: float = 0.0
    arrived: int = Field(default=0, ge=0, description="since the link was set")
    held_back: int = 0
    lost: int = 0


class Changed(_Part):
    """An input that a request concerns."""

    topic: str
    previous: str
    link: str


class LinkReply(_Part):
    """A service's answer: what the request did, its inputs, and the live changes it knows."""

    service: str
    changed: list[Changed] = Field(default_factory=list)
    inputs: list[LinkRow] = Field(default_factory=list)
    live: list[LinkEntry] = Field(default_factory=list, max_length=MAX_ENTRIES)


M = TypeVar("M", bound=_Part)


def to_wire(part: _Part) -> bytes:
    """Encode a request or a reply."""
    packed: bytes = msgpack.packb(part.model_dump(mode="json", exclude_defaults=True))
    return packed


def from_wire(payload: bytes, kind: type[M]) -> M:
    """Decode a request or a reply.

    Raises:
        LinkControlError: the bytes are no such thing.
    """
    longest = MAX_REPLY_BYTES if kind is LinkReply else MAX_BYTES
    if len(payload) > longest:
        raise LinkControlError(
            f"{kind.__name__}: expected at most {longest} bytes, got {len(payload)}"
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


class LinkTable:
    """Configured links of one service and the live changes over them. Pure."""

    def __init__(self, service: str, configured: Links) -> None:
        """Start with what was configured."""
        self._service = service
        self._configured = configured
        self._entries: dict[str, LinkEntry] = {}

    @property
    def entries(self) -> list[LinkEntry]:
        """Live changes, oldest first."""
        return sorted(self._entries.values(), key=lambda entry: entry.version)

    @property
    def version(self) -> int:
        """Of the newest change; -1 if there is none."""
        return max((entry.version for entry in self._entries.values()), default=-1)

    def of(self, topic: str) -> LinkSpec | None:
        """What is to be injected on an input now."""
        meant = [entry for entry in self._entries.values() if self._covers(entry.name, topic)]
        if not meant:
            return self._configured.of(self._service, topic)
        return max(meant, key=_weight).spec

    def concerned(self, request: LinkRequest, topics: Iterable[str]) -> list[str]:
        """Those of ``topics`` that a request is about."""
        if request.action == "clear":
            return list(topics)
        return [t for t in topics if any(self._covers(name, t) for name in request.links)]

    def apply(self, request: LinkRequest, now_ns: int) -> None:
        """Take in a request that changes something; one that does not is ignored.

        Args:
            request: what to do.
            now_ns: wall clock, for the version of a request without one.

        Raises:
            LinkControlError: a name is none, or the request contradicts itself or is older than
                what is known.
        """
        if request.action == "set":
            if not request.links:
                raise LinkControlError("set: expected at least one name with its link, got none")
            names = list(request.links)
        elif request.links:
            raise LinkControlError(
                f"{request.action}: expected no links, got {', '.join(request.links)}"
            )
        else:
            names = [EVERYTHING] if request.action == "clear" else []
        for name in names:
            _check_name(name)
        version = request.version
        if version is None:
            version = max(now_ns, self.version + 1)
        elif names and version <= self.version:
            raise LinkControlError(
                f"this change (version {version}) is older than what is in force "
                f"({self.version}); ask for the list and use a greater version"
            )
        entries = [
            LinkEntry(name=name, spec=request.links.get(name), version=version) for name in names
        ]
        if request.action == "set" and len(self._entries.keys() | names) > MAX_ENTRIES:
            raise LinkControlError(f"more than {MAX_ENTRIES} live changes; clear some first")
        kept = [entry for name, entry in self._entries.items() if name not in names]
        traced = sum(len(e.spec.trace) for e in (*kept, *entries) if e.spec is not None)
        if traced > MAX_TRACED:
            raise LinkControlError(
                f"{traced} recorded delays in live changes; expected at most {MAX_TRACED}: use "
                "shorter traces or clear some first"
            )
        self.merge(entries)

    def merge(self, entries: Iterable[LinkEntry]) -> None:
        """Take over what is newer than known; entries with names that are none are ignored."""
        for entry in entries:
            known = self._entries.get(entry.name)
            if known is not None and known.version >= entry.version:
                continue
            if known is None and len(self._entries) >= MAX_ENTRIES and entry.name != EVERYTHING:
                continue
            try:
                _check_name(entry.name)
            except LinkControlError:
                continue
            self._entries[entry.name] = entry
        cleared = self._entries.get(EVERYTHING)
        if cleared is not None:
            self._entries = {
                name: entry
                for name, entry in self._entries.items()
                if entry.version > cleared.version or name == EVERYTHING
            }

    def _covers(self, name: str, topic: str) -> bool:
        return name == EVERYTHING or _parsed(name).covers(self._service, topic)


def _weight(entry: LinkEntry) -> tuple[int, tuple[bool, bool, int]]:
    """The newest decides; of one request the more specific."""
    rank = (False, False, -1) if entry.name == EVERYTHING else _parsed(entry.name).rank
    return entry.version, rank


def _parsed(name: str) -> LinkName:
    # Any service may be named: which there are, only the bus knows.
    return parse_name(name, also=[name.rpartition(":")[0]])


def _check_name(name: str) -> None:
    if name == EVERYTHING:
        return
    try:
        _parsed(name)
    except ConfigError as error:
        raise LinkControlError(str(error)) from error
