"""The thread that moves samples from the queue to the file, part by part."""

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
        intake: where what arrives is put.
        episodes: the episodes so far; change nothing there.
        messages: recorded so far.
        bytes: of their payloads.
        lost: missing by sequence number, a second ago at most.
        undescribed: whether something is being recorded without a schema.
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
        """Prepare; nothing runs before :meth:`start`.

        Args:
            sink: where to write.
            config: buffering, and when a new part is due.
            robot: whose episode marks are followed.
            next_sink: opens the file of the next part; without it there is only one.
            episodes: what is known of episodes already.
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
        self._releasing: list[threading.Thread] = []
        self._stop = threading.Event()
        self._error: LoggerError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    @property
    def error(self) -> LoggerError | None:
        """Why recording ended, if it did; nothing is written after that."""
        return self._error

    @property
    def path(self) -> Path:
        """The part being written."""
        return self._sink.path

    def start(self) -> None:
        """Begin to record."""
        self._thread.start()

    def describe(self, descriptions: Mapping[str, Description]) -> None:
        """Say what senders say of their keys, from any thread."""
        self._described = dict(descriptions)

    def stop(self) -> dict[str, DeliveryCount]:
        """Record what is still queued, close the file and return the counts.

        Raises:
            LoggerError: the file could not be written, now or earlier.
        """
        self._stop.set()
        self._thread.join()
        for thread in self._releasing:
            thread.join()
        if self._error is not None:
            raise self._error
        self._finish()
        self._sink.release()
        return self._delivery.report()

    def _run(self) -> None:
        next_look = time.monotonic()
        next_flush = next_look + self._config.flush_period
        try:
            while not self._stop.wait(self._config.drain_period):
                self._drain()
                if time.monotonic() >= next_flush:
                    self._sink.flush()
                    next_flush = time.monotonic() + self._config.flush_period
                if time.monotonic() >= next_look:
                    self.lost = total(self._delivery.report()).lost
                    self.undescribed = self._sink.undescribed
                    next_look = time.monotonic() + 1.0
            self._drain()
        except LoggerError as error:
            self._error = error
            self._sink.abandon()
        except Exception as error:  # noqa: BLE001 - a recorder that stops must not do so in silence
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
            return  # recorded as it is; whoever reads the log will count it as refused
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
        """Go on in a new part; the old one is whole, and is put on the disk in the background."""
        old = self._sink
        self._finish()
        self._sink = next_sink()
        self._sink.describe(self._known)
        self._began = time.monotonic()
        self._sink.note(CARRIED_METADATA, carried(self._delivery, self.episodes))
        self._sink.flush()
        self._releasing = [thread for thread in self._releasing if thread.is_alive()]
        releasing = threading.Thread(target=_release, args=(old,), name="release", daemon=True)
        releasing.start()
        self._releasing.append(releasing)

    def _finish(self) -> None:
        self._sink.note(DELIVERY_METADATA, self._delivery.to_metadata())
        self._sink.finish()


def _release(sink: McapSink) -> None:
    try:
        sink.release()
    except LoggerError as error:
        _log.warning("%s", error)


def carried(delivery: DeliveryStats, episodes: EpisodeBook) -> dict[str, str]:
    """What a part needs to know of those before it, as MCAP metadata."""
    running = episodes.open
    return {
        "account": json.dumps(delivery.to_metadata()),
        "open_episode": json.dumps(None if running is None else asdict(running)),
        "next_episode": str(episodes.next_number),
    }
