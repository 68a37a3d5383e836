"""Moves samples from the queue to the log file, in a thread."""

import json
import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from common.errors import SchemaError
from common.schemas import EpisodeMark
from common.topics import EPISODE
from common.transport.keys import key_of
from common.transport.schema_query import Description
from common.transport.tap import RawSample
from common.wire.codec import decode
from common.wire.header import wire_header
from services.logger.errors import LoggerError
from services.logger.log_format import (
    CARRIED_METADATA,
    DELIVERY_METADATA,
    DROPS_METADATA,
    END_METADATA,
)
from services.logger.read.delivery import DeliveryCount, DeliveryStats, total
from services.logger.read.episodes import EpisodeBook
from services.logger.record.config import LoggerConfig
from services.logger.record.intake import Intake
from services.logger.record.sink import McapSink

_log = logging.getLogger("trill.logger")


class Recorder:
    """Drains an :class:`Intake` into a :class:`McapSink` until stopped.

    Attributes:
        intake: the queue of samples that arrived.
        episodes: the episodes so far; read only.
        messages: number of messages recorded so far.
        bytes: size of their payloads.
        lost: number of messages missing by sequence number, updated once a second.
        undescribed: whether a topic is being recorded without a schema.
    """

    def __init__(
        self,
        sink: McapSink,
        config: LoggerConfig,
        *,
        robot: str = "draco3",
        next_sink: Callable[[], McapSink] | None = None,
        episodes: EpisodeBook | None = None,
    ) -> None:
        """Prepare to write to ``sink``; :meth:`start` begins to record.

        The episode marks of ``robot`` are followed on from ``episodes``, those of earlier segments.
        ``next_sink`` opens the next segment's file; without it there is only one segment.
        """
        self.intake = Intake(config.queue_messages, config.queue_bytes)
        self.episodes = episodes or EpisodeBook()
        self.messages = 0
        self.bytes = 0
        self.lost = 0
        self.undescribed = False
        self._sink = sink
        self._config = config
        self._next_sink = next_sink
        self._episode_key = key_of(robot, EPISODE, "")
        self._delivery = DeliveryStats()
        self._described: Mapping[str, Description] | None = None
        self._known: Mapping[str, Description] = {}
        self._began = time.monotonic()
        self._syncing: list[threading.Thread] = []
        self._stop = threading.Event()
        self._error: LoggerError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    @property
    def error(self) -> LoggerError | None:
        """Why recording ended early; None if it did not."""
        return self._error

    @property
    def path(self) -> Path:
        """Path of the segment being written."""
        return self._sink.path

    def start(self) -> None:
        """Begin to record."""
        self._thread.start()

    def describe(self, descriptions: Mapping[str, Description]) -> None:
        """Provide senders' descriptions of their keys, from any thread."""
        self._described = dict(descriptions)

    def stop(self) -> dict[str, DeliveryCount]:
        """Record what is queued, close the file and return the delivery counts by key.

        Raises:
            LoggerError: the file could not be written, now or earlier.
        """
        self._stop.set()
        self._thread.join()
        for thread in self._syncing:
            thread.join()
        if self._error is not None:
            raise self._error
        self._sink.note(END_METADATA, {"monotonic_ns": str(time.monotonic_ns())})
        self._finish()
        self._sink.release()
        return self._delivery.report()

    def _run(self) -> None:
        next_count = time.monotonic()
        next_flush = next_count + self._config.flush_period
        try:
            while not self._stop.wait(self._config.drain_period):
                self._drain()
                if time.monotonic() >= next_flush:
                    self._sink.flush()
                    next_flush = time.monotonic() + self._config.flush_period
                if time.monotonic() >= next_count:
                    self.lost = total(self._delivery.report()).lost
                    self.undescribed = self._sink.undescribed
                    next_count = time.monotonic() + 1.0
            self._drain()
        except LoggerError as error:
            self._error = error
            self._sink.abandon()
        except Exception as error:  # noqa: BLE001 - whoever started it must see why it stopped
            _log.exception("recording failed")
            self._error = LoggerError(
                f"recording {self._sink.path} failed: {type(error).__name__}: {error}; what was "
                "flushed before stays readable"
            )
            self._sink.abandon()

    def _drain(self) -> None:
        if self._described is not None:
            self._known, self._described = self._described, None
            self._sink.describe(self._known)
        for sample in self.intake.take():
            self._record(sample)
            if self._next_sink is not None and self._is_full():
                self._rotate(self._next_sink)
        drops = self.intake.take_drops()
        if drops:
            self._delivery.add_drops(drops)
            self._sink.note(DROPS_METADATA, drops.to_metadata())

    def _record(self, sample: RawSample) -> None:
        header = wire_header(sample.payload)
        self._sink.write(sample, header)
        size = len(sample.payload)
        self._delivery.record(sample.key, header, size, sample.arrival_ns)
        self.messages += 1
        self.bytes += size
        if sample.key == self._episode_key:
            self._follow(sample)

    def _follow(self, sample: RawSample) -> None:
        """Follow an episode mark."""
        try:
            mark = decode(sample.payload, EpisodeMark, sample.tag or None)
        except SchemaError:
            return  # it is recorded as it is, and readers count it as refused
        self.episodes.observe(mark, sample.arrival_ns)

    def _is_full(self) -> bool:
        config = self._config
        if config.rotate_size is not None and self._sink.size >= config.rotate_size:
            return True
        return (
            config.rotate_every is not None
            and time.monotonic() - self._began >= config.rotate_every
        )

    def _rotate(self, next_sink: Callable[[], McapSink]) -> None:
        """Continue in a new segment; finish the old one and sync it in the background."""
        old = self._sink
        self._finish()
        self._sink = next_sink()
        self._sink.describe(self._known)
        self._began = time.monotonic()
        self._sink.note(CARRIED_METADATA, carried(self._delivery, self.episodes))
        self._sink.flush()
        self._syncing = [thread for thread in self._syncing if thread.is_alive()]
        syncing = threading.Thread(target=_release, args=(old,), name="sync", daemon=True)
        syncing.start()
        self._syncing.append(syncing)

    def _finish(self) -> None:
        self._sink.note(DELIVERY_METADATA, self._delivery.to_metadata())
        self._sink.finish()


def _release(sink: McapSink) -> None:
    try:
        sink.release()
    except LoggerError as error:
        _log.warning("%s", error)


def carried(delivery: DeliveryStats, episodes: EpisodeBook) -> dict[str, str]:
    """Return what a segment carries of those before it, as MCAP metadata."""
    running = episodes.open
    return {
        "account": json.dumps(delivery.to_metadata()),
        "open_episode": json.dumps(None if running is None else asdict(running)),
    }
