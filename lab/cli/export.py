"""``trill export`` and ``trill view``: a log in the forms that robotics viewers draw."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from deploy.system import LOG_FILE
from lab.errors import LabError

if TYPE_CHECKING:
    from collections.abc import Callable

    from services.logger.export.convert import Summary

EXPORT = """Convert a log to an MCAP file that robotics viewers draw: Foxglove, Rerun and anything
else that knows ROS 2 and protobuf. The log itself holds the bytes of the wire (msgpack), which no
viewer decodes.

  joints       /joints/measured, /joints/commanded      sensor_msgs/msg/JointState
  images       /camera/left, /camera/right              sensor_msgs/msg/CompressedImage
  poses        /base/..., /hands/<side>/...             foxglove.PoseInFrame
  robot        /tf (50 Hz), /robot (once)               foxglove.FrameTransforms, SceneUpdate
  task         /scene                                   foxglove.FrameTransforms
  delays       /links/<service>/<topic>                 trill.LinkPlot: ages, stages, injected delay
  events       /events                                  foxglove.Log
  everything   under its own topic, field by field      trill.<Message>, to plot any number

Times: log_time is the arrival at the logger, publish_time the sending, both moved from the
recorder's monotonic clock to its wall clock as noted at the start of the log. The stamp inside a
message is when its information was captured, on the same clock; robot time stays in the header of
the trill.<Message>. Quaternions are x, y, z, w by name in poses; w, x, y, z in trill.<Message>.

Works on logs cut off by a crash and on logs in several parts (log.mcap, log-2.mcap ...)."""
EXPORT_EXAMPLES = """examples:
  trill export runs/20260131-120000                     writes log-exported.mcap beside the log
  trill export runs/20260131-120000 -o walk.mcap --force
  trill export log.mcap --topics 'camera/*' plant/state
"""
VIEW = """Open a log in Rerun: robot in 3D, both eyes, set-points, joints, controller states,
errors, ages of the inputs and events on one time line. Needs Rerun: pip install 'trill[view]'
(170 MB).

The converted log is kept beside the log (log-view.rrd) and taken again next time. Rerun's usage
statistics are off; in a browser the page is kept from talking to anyone but this machine."""
VIEW_EXAMPLES = """examples:
  trill view runs/20260131-120000                       a window, or without a display as --web
  trill view runs/20260131-120000 --web --port 9090     the address to open is printed
  ssh -L 9090:127.0.0.1:9090 robot                      to look from another machine
"""
_TABLE_INDENT = "  "


def takes_export(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill export``."""
    _log_argument(parser)
    parser.add_argument(
        "-o", "--out", type=Path, help="file to write (<log>-exported.mcap beside the log)"
    )
    parser.add_argument(
        "--topics",
        nargs="+",
        default=[],
        metavar="TOPIC",
        help="only these topics of the log, without the robot's name; * and ? stand for anything",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def export(arguments: argparse.Namespace) -> int:
    """Convert a log; exit code 0 also if some topics were left out."""
    log = _log_of(arguments.log)
    out = arguments.out or log.with_name(f"{log.stem}-exported.mcap")
    with _extra("export"), _bar("converting") as progress:
        from services.logger.export.convert import export_log

        summary = export_log(
            log, out, topics=arguments.topics, force=arguments.force, on_progress=progress
        )
    print("\n".join(summary_lines(summary)))
    return 0


def takes_view(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill view``."""
    _log_argument(parser)
    parser.add_argument(
        "--web", action="store_true", help="serve to a browser on this machine, and say where"
    )
    parser.add_argument("--port", type=int, default=0, help="for --web (any free one)")
    parser.add_argument("--fresh", action="store_true", help="convert again, also if unchanged")


def view(arguments: argparse.Namespace) -> int:
    """Open a log in Rerun; returns the viewer's exit code."""
    log = _log_of(arguments.log)
    with _extra("view"):
        from services.logger.view import rerun

        rerun.require_rerun()
        with _bar("converting") as progress:
            prepared = rerun.prepare(log, fresh=arguments.fresh, on_progress=progress)
        if prepared.summary is not None:
            print("\n".join(_remarks(prepared.summary)))
        print(f"recording      {prepared.path}")
        if arguments.web or not rerun.has_display():
            rerun.show_in_browser(prepared.path, arguments.port, _tell_address)
            return 0
        return rerun.show(prepared.path)


def summary_lines(summary: "Summary") -> list[str]:
    """What was written, from what, and what was left out and why."""
    written = summary.written
    width = max(len(topic) for topic in written)
    lines = [f"{_TABLE_INDENT}{topic:<{width}} {written[topic]:>8}" for topic in sorted(written)]
    lines.append(
        f"{summary.converted.total()} messages of {len(summary.converted)} topics over "
        f"{summary.duration:.1f} s became {written.total()} of {len(written)}"
    )
    return [*lines, *_remarks(summary), f"written        {summary.path}"]


def _remarks(summary: "Summary") -> list[str]:
    left = [
        f"left out       {name}: {count} messages: {reason}"
        for name, (count, reason) in sorted(summary.left_out.items())
    ]
    return left + [f"note           {remark}" for remark in summary.remarks]


def _log_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG", help=f"{LOG_FILE}, or a run's directory")


def _log_of(path: Path) -> Path:
    return path / LOG_FILE if path.is_dir() else path


def _tell_address(url: str) -> None:
    print(f"open           {url}\nCtrl-C ends it", flush=True)


@contextmanager
def _extra(name: str) -> Iterator[None]:
    """Say which extra brings a missing library."""
    try:
        yield
    except ImportError as error:
        raise LabError(
            f"this needs {error.name}, which is not installed; pip install 'trill[{name}]' "
            f"(or -e '.[{name}]' in a checkout)"
        ) from error


@contextmanager
def _bar(text: str) -> "Iterator[Callable[[int, int], None]]":
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    ) as bars:
        task = bars.add_task(text, total=None)
        yield lambda done, total: bars.update(task, completed=done, total=total)
