"""Rebuilds from a log's messages what the log states about itself: delivery counts and episodes."""

import contextlib
import json
from collections.abc import Mapping

from mcap.records import Channel, McapRecord, Message, Metadata

from common.errors import SchemaError
from common.schemas import EpisodeMark
from common.topics import EPISODE
from common.wire.codec import decode
from common.wire.header import wire_header
from services.logger.errors import LoggerError
from services.logger.log_format import (
    CARRIED_METADATA,
    DELIVERY_METADATA,
    DROPS_METADATA,
    EPISODE_METADATA,
)
from services.logger.read.delivery import DeliveryStats
from services.logger.read.episodes import Episode, EpisodeBook, merged


class RebuiltMetadata:
    """Takes in a log's records in order; passes over what it cannot read.

    Attributes:
        delivery: the delivery statistics so far.
        channels: the channels known so far.
        messages: number of messages so far.
        unknown: number of messages so far whose channel is unknown.
    """

    def __init__(self) -> None:
        """Start without any record."""
        self.delivery = DeliveryStats()
        self.channels: dict[int, Channel] = {}
        self.messages = 0
        self.unknown = 0
        self._book = EpisodeBook()
        self._records: list[Episode] = []
        self._last_ns = 0

    def add(self, record: McapRecord) -> None:
        """Take in one record of any kind."""
        if isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Message):
            self._add_message(record)
        elif isinstance(record, Metadata):
            self._add_metadata(record.name, record.metadata)

    def _add_message(self, message: Message) -> None:
        channel = self.channels.get(message.channel_id)
        if channel is None:
            self.unknown += 1
            return
        self.messages += 1
        self._last_ns = max(self._last_ns, message.log_time)
        header = wire_header(message.data)
        self.delivery.record(channel.topic, header, len(message.data), message.log_time)
        if channel.metadata.get("topic") == EPISODE.name:
            with contextlib.suppress(SchemaError):
                mark = decode(message.data, EpisodeMark, channel.metadata.get("schema_tag") or None)
                self._book.observe(mark, message.log_time)

    def _add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        with contextlib.suppress(LoggerError, ValueError, KeyError, TypeError):
            if name == CARRIED_METADATA:
                self.delivery = DeliveryStats.from_metadata(json.loads(values["account"]))
                running = json.loads(values["open_episode"])
                self._book = EpisodeBook(
                    None if running is None else Episode(**running), int(values["next_episode"])
                )
            elif name == DROPS_METADATA:
                self.delivery.add_drops(DeliveryStats.from_metadata(values))
            elif name == DELIVERY_METADATA:
                self.delivery.add_sent(DeliveryStats.from_metadata(values))
            elif name == EPISODE_METADATA:
                self._records.append(Episode.from_metadata(values))

    def unrecorded_episodes(self) -> list[Episode]:
        """Return the episodes that have marks but no record; an open one counts as interrupted."""
        self._book.close(self._last_ns)
        known = {(one.episode, one.start_ns) for one in self._records}
        return [
            one
            for one in merged(self._records, self._book.finished)
            if (one.episode, one.start_ns) not in known
        ]
