"""The thread that moves samples from the queue to the file."""

import threading
import time

from common.bus.wire import wire_header
from services.logger.config import LoggerConfig
from services.logger.errors import LoggerError
from services.logger.intake import Intake
from services.logger.sink import McapSink
from services.logger.tally import KeyCount, Tally, to_metadata


class Recorder:
    """Drains an :class:`Intake` into a :class:`McapSink` until stopped.

    Attributes:
        intake: where what arrives is put.
    """

    def __init__(self, sink: McapSink, config: LoggerConfig) -> None:
        """Prepare; nothing runs before :meth:`start`."""
        self.intake = Intake(config.queue_messages, config.queue_bytes)
        self._sink = sink
        self._config = config
        self._tally = Tally()
        self._stop = threading.Event()
        self._error: LoggerError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    @property
    def error(self) -> LoggerError | None:
        """Why recording ended, if it did; nothing is written after that."""
        return self._error

    def start(self) -> None:
        """Begin to record."""
        self._thread.start()

    def report(self) -> dict[str, KeyCount]:
        """Counts so far, by key."""
        return self._tally.report(self.intake.dropped())

    def stop(self) -> dict[str, KeyCount]:
        """Record what is still queued, close the file and return the counts.

        Raises:
            LoggerError: the file could not be written, now or earlier.
        """
        self._stop.set()
        self._thread.join()
        if self._error is not None:
            raise self._error
        report = self.report()
        self._sink.close(to_metadata(report))
        return report

    def _run(self) -> None:
        next_flush = time.monotonic() + self._config.flush_period
        try:
            while not self._stop.wait(self._config.drain_period):
                self._drain()
                if time.monotonic() >= next_flush:
                    self._sink.flush()
                    next_flush = time.monotonic() + self._config.flush_period
            self._drain()
        except LoggerError as error:
            self._error = error
            self._sink.abandon()

    def _drain(self) -> None:
        for sample in self.intake.take():
            header = wire_header(sample.payload)
            self._sink.write(sample, header)
            self._tally.record(sample.key, header)
