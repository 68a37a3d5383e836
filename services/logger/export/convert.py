"""Converts a log to a file that robotics viewers decode."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from common.errors import SchemaError
from common.schemas import Message, ServiceHealth
from common.wire.decoder import Decoders
from services.logger.errors import ExportError
from services.logger.export.output import ExportFile, export_file
from services.logger.export.robot import RobotModel
from services.logger.export.routes import NOT_EXPORTED, Routes
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader, RecordedMessage
from services.logger.read.sender_clocks import SenderClocks, Times

OnProgress = Callable[[int, int], None]
"""Called with how many messages are done, and of how many."""
_PROGRESS_STEP = 500


@dataclass
class Summary:
    """What was exported of a log, and what was not.

    Attributes:
        path: the exported file.
        converted: messages read, by source topic (with source).
        written: messages written, by exported topic.
        left_out: number of messages not converted and the last reason, by source topic.
        duration: between the first and last arrival of what was converted, without pauses [s].
        remarks: anything else a person should know.
    """

    path: Path
    converted: Counter[str] = field(default_factory=Counter)
    written: Counter[str] = field(default_factory=Counter)
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)
    duration: float = 0.0
    remarks: list[str] = field(default_factory=list)

    def leave_out(self, name: str, reason: str) -> None:
        """Count one message of ``name`` as not converted."""
        count, _ = self.left_out.get(name, (0, ""))
        self.left_out[name] = (count + 1, reason)


def export_log(
    log: Path,
    out: Path,
    *,
    topics: Sequence[str] = (),
    force: bool = False,
    ros2: bool = False,
    on_progress: OnProgress = lambda done, total: None,
) -> Summary:
    """Convert ``log`` to ``out``.

    Args:
        log: a log, or the first of its segments; may be cut off.
        out: the file to write.
        topics: only these, e.g. ``plant/state`` or ``camera/*``; empty: all.
        force: replace an existing ``out``.
        ros2: write messages of ROS 2 only.
        on_progress: called now and then.

    Raises:
        LoggerError: there is no readable log.
        ExportError: a wanted topic is not in the log, or ``out`` cannot be written.
    """
    if out.exists() and log.exists() and out.samefile(log):
        raise ExportError(f"{out} is the log itself; give another -o")
    info = read_info(log)
    keys = info.topics
    names = sorted({_name(one.key) for one in keys})
    for pattern in topics:
        if not any(fnmatchcase(name, pattern) for name in names):
            known = ", ".join(names) or "none"
            raise ExportError(f"no topic of {log} matches {pattern!r}; it has: {known}")
    total = sum(one.messages for one in keys)
    summary = Summary(out, remarks=[*info.remarks, *map(str, info.pauses)])
    reader = LogReader(log)
    conversion = _Conversion(reader, topics, summary, ros2=ros2)
    with export_file(out, force=force, profile="ros2" if ros2 else "") as file:
        for done, message in enumerate(reader.raw_messages()):
            if done % _PROGRESS_STEP == 0:
                on_progress(done, total)
            conversion.add(message, file)
        if not file.counts:
            left = summary.left_out.items()
            why = "; ".join(f"{name}: {reason}" for name, (_, reason) in left)
            raise ExportError(f"nothing in {log} can be exported: {why or 'it has no messages'}")
        file.finish({"source": log.name, **{f"log.{k}": v for k, v in reader.origin.items()}})
        summary.written = file.counts
    on_progress(total, total)
    conversion.finish()
    return summary


class _Conversion:
    """Converts message by message and fills the summary."""

    def __init__(
        self, reader: LogReader, topics: Sequence[str], summary: Summary, *, ros2: bool
    ) -> None:
        self._reader = reader
        self._routes = Routes(_robot(summary), ros2=ros2)
        self._topics = topics
        self._summary = summary
        self._clocks = SenderClocks()
        self._decoders = Decoders()
        self._first_ns: int | None = None
        self._last_ns = 0

    def add(self, raw: RecordedMessage, file: ExportFile) -> None:
        """Write the samples of a message, or note why there are none."""
        name = _name(raw.key)
        topic, reason = raw.topic, self._reason_to_skip(raw, name)
        if topic is None or reason:
            self._summary.leave_out(name, reason)
            return
        try:
            message = self._decoders.decode(raw.key, raw.payload, topic.schema, raw.tag or None)
            times = self._times(message, raw.log_time)
            samples = list(self._routes(topic.name, name, message, times))
        except (SchemaError, ExportError) as error:
            self._summary.leave_out(name, str(error))
            return
        if not samples:
            self._summary.leave_out(name, "nothing that ROS 2 has a message for")
            return
        for sample in samples:
            file.write(sample, times, raw.sequence)
        self._summary.converted[name] += 1
        self._first_ns = raw.time_ns if self._first_ns is None else self._first_ns
        self._last_ns = raw.time_ns

    def _times(self, message: Message, log_time: int) -> Times:
        """Return the times of a message on the wall clock."""
        times = self._clocks.times(message.header, log_time)
        if isinstance(message, ServiceHealth):
            self._clocks.learn(message)
        offset = self._reader.time_line.wall_offset_ns or 0
        return Times(times.stamp + offset, times.sent + offset, times.logged + offset)

    def _reason_to_skip(self, raw: RecordedMessage, name: str) -> str:
        if self._topics and not any(fnmatchcase(name, pattern) for pattern in self._topics):
            return "not among --topics"
        if raw.topic is None:
            return "not in the topic table"
        return NOT_EXPORTED.get(raw.topic.name, "")

    def finish(self) -> None:
        """Add to the summary what is known at the end."""
        summary = self._summary
        summary.duration = (self._last_ns - (self._first_ns or 0)) * 1e-9
        if self._reader.truncated:
            summary.remarks.append("the log is cut off; everything before that is converted")
        if self._reader.time_line.wall_offset_ns is None:
            summary.remarks.append(
                "the log does not tie its clock to the wall clock: times count from the "
                "recorder's boot"
            )


def _name(key: str) -> str:
    """Return the key without the robot."""
    return key.partition("/")[2] or key


def _robot(summary: Summary) -> RobotModel | None:
    try:
        return RobotModel()
    except ImportError:
        summary.remarks.append(
            "MuJoCo is not installed: no link transforms, shapes, camera data and measured hands "
            "(pip install '.[sim]' in a checkout of trill)"
        )
        return None
