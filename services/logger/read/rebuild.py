"""Rebuilds the delivery statistics of a log without its end from the records that are there."""

import contextlib
import json
from collections.abc import Mapping

from mcap.records import Channel, McapRecord, Message, Metadata

from common.wire.header import wire_header
from services.logger.errors import LoggerError
from services.logger.log_format import CARRIED_METADATA, DELIVERY_METADATA, DROPS_METADATA
from services.logger.read.delivery import DeliveryStats


class DeliveryRebuilder:
    """Takes in a log's records in order; passes over what it cannot read.

    Attributes:
        stats: the delivery statistics so far.
        channels: the channels known so far.
        messages: number of messages so far.
        unknown: number of messages so far whose channel is unknown.
    """

    def __init__(self) -> None:
        """Start without any record."""
        self.stats = DeliveryStats()
        self.channels: dict[int, Channel] = {}
        self.messages = 0
        self.unknown = 0

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
        header = wire_header(message.data)
        self.stats.record(channel.topic, header, len(message.data), message.log_time)

    def _add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        with contextlib.suppress(LoggerError, ValueError, KeyError):
            if name == CARRIED_METADATA:
                self.stats = DeliveryStats.from_metadata(json.loads(values["account"]))
            elif name == DROPS_METADATA:
                self.stats.add_drops(DeliveryStats.from_metadata(values))
            elif name == DELIVERY_METADATA:
                self.stats.add_sent(DeliveryStats.from_metadata(values))
