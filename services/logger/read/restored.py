"""Works out anew what a log says about itself: its account and its episodes."""

import contextlib
import json
from collections.abc import Mapping

from mcap.records import Channel, Message, Metadata

from common.errors import SchemaError
from common.schemas import EpisodeMark
from common.topics import EPISODE
from common.wire.codec import decode
from common.wire.header import wire_header
from services.logger.errors import LoggerError
from services.logger.log_format import (
    ACCOUNT_METADATA,
    CARRIED_METADATA,
    DROPS_METADATA,
    EPISODE_METADATA,
)
from services.logger.read.episodes import Episode, EpisodeBook, merged
from services.logger.read.tally import Tally


class RebuiltMetadata:
    """Fed with a log's records in order; what cannot be read is passed over.

    Attributes:
        tally: the account so far.
        messages: fed so far.
    """

    def __init__(self) -> None:
        """Start with nothing."""
        self.tally = Tally()
        self.messages = 0
        self._book = EpisodeBook()
        self._records: list[Episode] = []
        self._last_ns = 0

    def take(self, record: object, channels: dict[int, Channel]) -> None:
        """Take any record into account; ``channels`` are those known, and get more."""
        if isinstance(record, Channel):
            channels.setdefault(record.id, record)
        elif isinstance(record, Message) and record.channel_id in channels:
            self.message(channels[record.channel_id], record)
        elif isinstance(record, Metadata):
            self.metadata(record.name, record.metadata)

    def message(self, channel: Channel, message: Message) -> None:
        """Take a recorded message into account."""
        self.messages += 1
        self._last_ns = max(self._last_ns, message.log_time)
        header = wire_header(message.data)
        self.tally.record(channel.topic, header, len(message.data), message.log_time)
        if channel.metadata.get("topic") == EPISODE.name:
            with contextlib.suppress(SchemaError):
                mark = decode(message.data, EpisodeMark, channel.metadata.get("schema_tag") or None)
                self._book.observe(mark, message.log_time)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Take one of the log's own remarks into account."""
        with contextlib.suppress(LoggerError, ValueError, KeyError, TypeError):
            if name == CARRIED_METADATA:
                self.tally = Tally.from_state(json.loads(values["account"]))
                running = json.loads(values["open_episode"])
                self._book = EpisodeBook(
                    None if running is None else Episode(**running), int(values["next_episode"])
                )
            elif name == DROPS_METADATA:
                self.tally.add_drops(Tally.from_state(values))
            elif name == ACCOUNT_METADATA:
                self.tally.hear(Tally.from_state(values))
            elif name == EPISODE_METADATA:
                self._records.append(Episode.from_metadata(values))

    def unrecorded_episodes(self) -> list[Episode]:
        """Episodes that have marks but no record; one that is open is interrupted here."""
        self._book.close(self._last_ns)
        recorded = set(self._records)
        known = {(one.episode, one.start_ns) for one in recorded}
        return [
            one
            for one in merged(recorded, self._book.finished)
            if (one.episode, one.start_ns) not in known
        ]
