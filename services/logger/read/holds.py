"""Finds who had the robot when in a log, without reading all of it.

The controller says ten times a second who has the robot, and counts the changes. Where two chunks
have the same count nothing changed in between, so that a search by halves reads few of the chunks
of a long log.
"""

from collections.abc import Iterator, Sequence

from mcap.records import Channel

from common.errors import SchemaError
from common.operator.holds import Hold, HoldBook
from common.schemas import AuthorityState
from common.topics import WBC_AUTHORITY
from common.wire.codec import decode
from services.logger.errors import LoggerError
from services.logger.read.index import LogIndex, MessagePlace

_Arrived = tuple[int, AuthorityState]
"""A state with its arrival, monotonic clock [ns]."""


def read_holds(segments: Sequence[tuple[LogIndex, int]]) -> list[Hold]:
    """Return who had the robot, by arrivals on the recording's clock [ns].

    Args:
        segments: index and shift from its monotonic clock to the recording's [ns] of each segment.
    """
    book = HoldBook()
    for index, shift_ns in segments:
        for at_ns, state in _around_changes(index):
            book.observe(state, at_ns + shift_ns)
    return book.holds


def _is_authority(channel: Channel) -> bool:
    return bool(channel.metadata.get("topic") == WBC_AUTHORITY.name)


def _around_changes(index: LogIndex) -> Iterator[_Arrived]:
    """Yield the states in the first and the last chunk and wherever the robot changed hands."""
    places = index.places_of(_is_authority)
    found: dict[int, list[_Arrived]] = {}
    open_spans = [(0, len(places) - 1)] if places else []
    while open_spans:
        first, last = open_spans.pop()
        for number in (first, last):
            if number not in found:
                found[number] = _states(index, places[number])
        middle = (first + last) // 2
        if middle > first and _count(found[first][-1:]) != _count(found[last][:1]):
            open_spans += [(first, middle), (middle, last)]
    for number in sorted(found):
        yield from found[number]


def _states(index: LogIndex, place: MessagePlace) -> list[_Arrived]:
    """Return the readable states at a place; none where it is damaged."""
    found = []
    try:
        for channel, message in index.messages(_is_authority, [place]):
            tag = channel.metadata.get("schema_tag") or None
            try:
                found.append((message.log_time, decode(message.data, AuthorityState, tag)))
            except SchemaError:
                continue
    except LoggerError:
        return found
    return found


def _count(states: Sequence[_Arrived]) -> tuple[int, int] | None:
    """Return the controller's run and how often the robot had changed hands at a state."""
    return (states[0][1].header.boot, states[0][1].changes) if states else None
