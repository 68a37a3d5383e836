"""From a log to a file that viewers decode."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from common.errors import SchemaError
from common.wire.codec import decode
from services.logger.export.clock import WallClock
from services.logger.export.errors import ExportError
from services.logger.export.output import ExportFile
from services.logger.export.robot import RobotModel
from services.logger.export.routes import NOT_EXPORTED, Routes
from services.logger.read.reader import LogReader, RecordedMessage

Progress = Callable[[int, int], None]
"""Told how many messages are done, and of how many."""
_TELL_EVERY = 500


@dataclass
class Summary:
    """What became of a log.

    Attributes:
        path: the exported file.
        converted: messages read, by source topic (with source).
        written: messages written, by exported topic.
        left_out: messages not converted, by source topic, with the reason.
        duration: between the first and last arrival of what was converted [s].
        remarks: anything else a person should know.
    """

    path: Path
    converted: Counter[str] = field(default_factory=Counter)
    written: Counter[str] = field(default_factory=Counter)
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)
    duration: float = 0.0
    remarks: list[str] = field(default_factory=list)

    def leave_out(self, name: str, reason: str) -> None:
        """Count one message of ``name`` as not converted; the newest reason stands."""
        count, _ = self.left_out.get(name, (0, ""))
        self.left_out[name] = (count + 1, reason)


def export_log(
    log: Path,
    out: Path,
    *,
    topics: Sequence[str] = (),
    force: bool = False,
    progress: Progress = lambda done, total: None,
) -> Summary:
    """Convert ``log`` to ``out``.

    Args:
        log: a log, or the first of its parts; may be cut off.
        out: the file to write.
        topics: only these, e.g. ``plant/state`` or ``camera/*``; empty: all.
        force: replace an existing ``out``.
        progress: told now and then.

    Raises:
        LoggerError: there is no readable log.
        ExportError: a wanted topic is not in the log, or ``out`` cannot be written.
    """
    if out.exists() and log.exists() and out.samefile(log):
        raise ExportError(f"{out} is the log itself; give another -o")
    names = Counter(_name(entry) for entry in LogReader(log).raw_messages())
    for pattern in topics:
        if not any(fnmatchcase(name, pattern) for name in names):
            known = ", ".join(sorted(names)) or "none"
            raise ExportError(f"no topic of {log} matches {pattern!r}; it has: {known}")
    summary = Summary(out)
    robot = _robot(summary)
    reader = LogReader(log)
    job = _Job(reader, Routes(robot), topics, summary)
    with ExportFile(out, force=force) as file:
        for done, entry in enumerate(reader.raw_messages()):
            if done % _TELL_EVERY == 0:
                progress(done, names.total())
            job.convert(entry, file)
        if not file.counts:
            raise ExportError(f"nothing in {log} can be exported: {job.reasons()}")
        file.note({"source": log.name, **{f"log.{k}": v for k, v in reader.origin.items()}})
        summary.written = file.counts
    progress(names.total(), names.total())
    job.conclude()
    return summary


class _Job:
    """Converts entry by entry and keeps the books."""

    def __init__(
        self, reader: LogReader, routes: Routes, topics: Sequence[str], summary: Summary
    ) -> None:
        self._reader = reader
        self._routes = routes
        self._topics = topics
        self._summary = summary
        self._origin: dict[str, str] = {}
        self._clock = WallClock()
        self._first: int | None = None
        self._last = 0

    def convert(self, entry: RecordedMessage, file: ExportFile) -> None:
        """Write what becomes of ``entry``, or say why nothing does."""
        name = _name(entry)
        reason = self._unwanted(entry, name)
        if reason:
            self._summary.leave_out(name, reason)
            return
        assert entry.topic is not None
        # Each part of a recording has its own origin, perhaps of another boot of the machine.
        if self._reader.origin is not self._origin:
            self._origin = self._reader.origin
            self._clock = WallClock.of(self._origin)
        try:
            message = decode(entry.payload, entry.topic.schema, entry.tag or None)
            times = self._clock.times(message.header, entry.log_time)
            samples = list(self._routes(entry.topic.name, name, message, times))
        except (SchemaError, ExportError) as error:
            self._summary.leave_out(name, str(error))
            return
        for sample in samples:
            file.write(sample, times, entry.sequence)
        self._summary.converted[name] += 1
        self._first = times.logged if self._first is None else self._first
        self._last = times.logged

    def conclude(self) -> None:
        """Add what is known at the end."""
        summary = self._summary
        summary.duration = (self._last - (self._first or 0)) * 1e-9
        if self._reader.truncated:
            summary.remarks.append("the log is cut off; everything before that is converted")
        if not self._clock.known:
            summary.remarks.append(
                "the log does not tie its clock to the wall clock: times count from the "
                "recorder's boot"
            )

    def reasons(self) -> str:
        """Why messages were left out, in one line."""
        left = self._summary.left_out.items()
        return "; ".join(f"{name}: {reason}" for name, (_, reason) in left) or "it has no messages"

    def _unwanted(self, entry: RecordedMessage, name: str) -> str:
        if self._topics and not any(fnmatchcase(name, pattern) for pattern in self._topics):
            return "not among --topics"
        if entry.topic is None:
            return "not in the topic table"
        return NOT_EXPORTED.get(entry.topic.name, "")


def _name(entry: RecordedMessage) -> str:
    """The key without the robot."""
    return entry.key.partition("/")[2] or entry.key


def _robot(summary: Summary) -> RobotModel | None:
    try:
        return RobotModel()
    except ImportError:
        summary.remarks.append(
            "MuJoCo is not installed: no link transforms, shapes and measured hands "
            "(pip install 'trill[sim]')"
        )
        return None
