"""Write summary and pictures of a finished run from its log, and print a short report."""

from collections import Counter
from pathlib import Path

from common.errors import TrillError
from common.files import write_whole
from common.packages import install_hint
from common.transport.keys import topic_of
from deploy.launch import Verdict
from deploy.system import LOG_FILE
from lab.errors import LabError
from lab.progress import ProgressBar
from lab.review.heap import trim_heap
from lab.review.run_summary import RunSummary, ServiceTiming
from lab.review.summary import summarise
from lab.review.summary_readers import LogFindings
from lab.review.task_summary import trial_lines
from lab.review.timeline import Timeline
from lab.trials.provenance import environment
from services.logger.read.info import read_info
from services.logger.read.log_info import LogInfo
from services.logger.read.reader import LogReader
from services.logger.read.segments import existing_segments

SUMMARY_FILE = "summary.json"
SHEET_FILE = "contact_sheet.png"
VIDEO_FILE = "video.mp4"
_RECORDING = "the log is still being recorded: this is the run up to now"


def finish(
    log: Path, verdict: Verdict, settings: dict[str, str], *, pictures: bool, video: bool
) -> RunSummary:
    """Summarise the log of a finished run, print the report and draw the pictures.

    Raises:
        LoggerError: there is no readable log.
        LabError: the summary cannot be written.
    """
    if existing_segments(log)[0].exists():
        print("reading the log", flush=True)
    timeline = Timeline() if pictures else None
    summary = write_summary(log, verdict, settings, timeline)
    trim_heap()
    print("\n".join(report_lines(summary)), flush=True)
    if timeline is not None and (failure := draw_pictures(log, timeline, video=video)):
        print(failure)
    print("\n".join(file_lines(log)), flush=True)
    return summary


def beside(log: Path, name: str) -> Path:
    """Return the path of a file about ``log``; only a run's own log leaves its name away."""
    return log.with_name(name if log.name == LOG_FILE else f"{log.stem}-{name}")


def known_verdict(log: Path) -> tuple[Verdict, dict[str, str]]:
    """Return verdict and settings from an earlier summary; "unknown" and none without one."""
    path = beside(log, SUMMARY_FILE)
    try:
        known = RunSummary.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return Verdict("unknown", "only the log is left"), {}
    return Verdict(known.outcome, known.reason), known.environment


def write_summary(
    log: Path, verdict: Verdict, settings: dict[str, str], timeline: Timeline | None = None
) -> RunSummary:
    """Summarise a run's log into ``summary.json``, with versions and ``settings``.

    The messages are added to ``timeline`` on the way, so that the log is read once.

    Raises:
        LoggerError: there is no readable log.
        LabError: it is the log of something else, or the summary cannot be written.
    """
    info, reader = read_info(log), LogReader(log)
    summary = summarise(
        reader.messages() if timeline is None else timeline.added(reader.messages()),
        about_log=lambda: _findings(info, reader),
        outcome=verdict.outcome,
        reason=verdict.reason,
        environment={**environment(), **settings},
    )
    if not summary.topics and verdict.outcome == "unknown":
        raise LabError(
            f"{log} holds no message of this project: expected a log that a run or `trill record` "
            "wrote; `trill info` shows what is in it"
        )
    path = beside(log, SUMMARY_FILE)
    try:
        # Atomically: the verdict is kept nowhere else, and a full disk must not destroy it.
        write_whole(path, (summary.model_dump_json(indent=2) + "\n").encode())
    except OSError as error:
        raise LabError(f"cannot write {path}: {error.strerror}") from error
    return summary


def _findings(info: LogInfo, reader: LogReader) -> LogFindings:
    """Return what is known about the log, once ``reader`` has read to the end."""
    recording = any(segment.open for segment in info.segments)
    lost: Counter[str] = Counter()
    dropped: Counter[str] = Counter()
    for one in info.topics:
        topic = topic_of(info.origin.get("robot", ""), one.key)
        if topic is not None:
            lost[topic.name] += one.count.lost
            dropped[topic.name] += one.count.dropped
    return LogFindings(
        lost=lost,
        dropped=dropped,
        refused=reader.refused,
        truncated=reader.truncated and not recording,
        remarks=[*map(str, info.pauses), *info.remarks, *[_RECORDING] * recording],
    )


def draw_pictures(log: Path, timeline: Timeline, *, video: bool) -> str:
    """Render contact sheet and video of a log's timeline; return why that failed, or "".

    Nothing is raised: a run is valid without its pictures, for instance without OpenGL.
    """
    try:
        from lab.review.pictures import write_contact_sheet, write_video
    except ImportError as error:
        return f"no pictures: {error}; {install_hint('deploy,sim')}"
    try:
        with ProgressBar("contact sheet") as bar:
            write_contact_sheet(beside(log, SHEET_FILE), timeline, bar.show)
        if video:
            with ProgressBar("video (Ctrl-C skips it)") as bar:
                write_video(beside(log, VIDEO_FILE), timeline, bar.show)
    except TrillError as error:
        return f"no pictures: {error}"
    except KeyboardInterrupt:
        return "Ctrl-C: the pictures are not complete"
    return ""


def report_lines(summary: RunSummary) -> list[str]:
    """Format a summary for a person, line by line."""
    walk, plant, tracking = summary.walk, summary.plant, summary.tracking
    total = summary.gaits["total"]
    lines = [
        f"outcome        {summary.outcome}"
        + (f": {summary.reason.splitlines()[0]}" if summary.reason else ""),
        *trial_lines(summary.trials),
        f"robot time     {summary.duration:.1f} s at real-time factor {plant.real_time_factor:.3f}"
        f" (worst second {plant.real_time_factor_worst:.3f}), falls {plant.falls}"
        + (f", plant started {plant.lives} times" if plant.lives > 1 else ""),
        f"gaits          {total.completed} completed of {total.accepted} accepted and "
        f"{total.requested} requested; {total.refused} refusals"
        + "".join(
            f"\n               {name.replace('_', ' '):<11} {counts.completed}/{counts.requested}"
            f"{_means(summary, name)}"
            for name, counts in summary.gaits.items()
            if name != "total"
        ),
        f"walked         {walk.distance:.3f} m of {walk.commanded_distance:.3f} m commanded, "
        f"turned {walk.turn_deg:+.1f} deg of {walk.commanded_turn_deg:+.1f}; "
        f"ended {1e3 * walk.end_error:.0f} mm from the commanded position",
        f"hands          off by {tracking.hand_position_mm.median:.1f} mm (p99 "
        f"{tracking.hand_position_mm.p99:.1f}), {tracking.hand_rotation_deg.median:.1f} deg (p99 "
        f"{tracking.hand_rotation_deg.p99:.1f})",
        f"age at torque  {plant.age_at_torque_median_ms:.1f} ms (p99 "
        f"{plant.age_at_torque_p99_ms:.1f}, worst second {plant.age_at_torque_p99_worst_ms:.1f}); "
        f"commands refused {plant.commands_refused}, holds {plant.holds}",
    ]
    lines += [
        f"{'stops, holder' if number == 0 else '':<14} {event.at:.1f} s: {event.text}"
        for number, event in enumerate(summary.events)
    ]
    lines += [
        f"{'interventions' if number == 0 else '':<14} {one.at:.1f} s: {one.operator} for "
        f"{one.length:.1f} s" + (f", until {one.until}" if one.until else "")
        for number, one in enumerate(summary.interventions)
    ]
    lines += [_service_line(name, service) for name, service in summary.services.items()]
    gaps = sum(topic.gaps for topic in summary.topics.values())
    dropped = sum(topic.dropped for topic in summary.topics.values())
    count = sum(topic.messages for topic in summary.topics.values())
    lines.append(
        f"log            {count} messages, {gaps} missing, {dropped} dropped by the logger"
        + ("; truncated: its end was never written" if summary.log_truncated else "")
    )
    return lines + [f"{'':<14} {remark}" for remark in summary.log_remarks]


def file_lines(log: Path) -> list[str]:
    """List the files of a run, line by line: all segments of its log, and what is about it."""
    about = [beside(log, name) for name in (SUMMARY_FILE, SHEET_FILE, VIDEO_FILE)]
    files = [*existing_segments(log), *about, log.with_name("logs")]
    there = [path for path in files if path.exists()]
    return [f"{'files' if number == 0 else '':<14} {path}" for number, path in enumerate(there)]


def _means(summary: RunSummary, gait: str) -> str:
    """Format the mean motion of one gait type in its commanded direction, for the report."""
    runs = [r for r in summary.gait_runs if r.gait == gait and r.outcome == "completed"]
    if not runs:
        return ""
    first = runs[0]
    for name, value, wanted, unit in (
        ("forward", [r.forward for r in runs], first.commanded_forward, "m"),
        ("left", [r.left for r in runs], first.commanded_left, "m"),
        ("turn", [r.turn_deg for r in runs], first.commanded_turn_deg, "deg"),
    ):
        if wanted:
            return f"  {name} {sum(value) / len(value):+.3f} {unit} of {wanted:+.3f}"
    return ""


def _service_line(name: str, service: ServiceTiming) -> str:
    return (
        f"{name:<14} loop {service.step_median_ms:.2f} ms (p99 {service.step_p99_ms:.2f}) of "
        f"{service.period_ms:.0f}, missed {service.deadline_misses} of {service.steps}, "
        f"CPU {100 * service.cpu:.0f} %, {service.realtime}"
        + (f", started {service.lives} times" if service.lives > 1 else "")
    )
