"""``trill export`` and ``trill view``: convert a log for robotics viewers, or open it in one."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from common.packages import require
from lab.cli.commands import Action
from lab.cli.log_argument import add_log_argument, chosen_log
from services.logger.record.units import parse_patterns

if TYPE_CHECKING:
    from services.logger.export.convert import Summary

EXPORT = """Convert a log to an MCAP file for robotics viewers: Foxglove, Rerun and anything else
that reads ROS 2 and protobuf. The log itself holds the bytes of the wire (msgpack), which viewers
do not decode.

  joints       /joints/measured, /joints/commanded      sensor_msgs/msg/JointState
  images       /camera/left, /camera/right              sensor_msgs/msg/CompressedImage
  poses        /base/..., /hands/<side>/...             foxglove.PoseInFrame
  robot        /tf (50 Hz), /robot (once)               foxglove.FrameTransforms, SceneUpdate (the
                                                        shapes; Foxglove draws them, and for Rerun
                                                        `trill view` adds them in its own form)
  task         /scene                                   foxglove.FrameTransforms
  delays       /links/<service>/<topic>                 trill.LinkPlot: ages, stages, injected delay
  cameras      /camera/<eye>/camera_info                sensor_msgs/msg/CameraInfo
  events       /events                                  foxglove.Log
  everything   under its own topic, field by field      trill.<Message>, to plot any number

With --ros2 the file has messages of ROS 2 only, for `ros2 bag play` and whatever reads bags:
JointState, CompressedImage, CameraInfo, PoseStamped, TFMessage in /tf (scene and cameras too), and
the events in /rosout.

Times: log_time is the arrival at the logger and publish_time the sending, both converted from the
recorder's monotonic clock to its wall clock. The stamp inside a message is when its information was
captured, on the same clock; robot time stays in the header of the trill.<Message>. Poses name the
parts of a quaternion; in trill.<Message> they are w, x, y, z.

Logs that are cut off by a crash, or are in several segments (log.mcap, log-2.mcap ...), are
converted too."""
EXPORT_EXAMPLES = """examples:
  trill export runs/20260131-120000                     writes log-exported.mcap beside the log
  trill export runs/20260131-120000 -o walk.mcap --force
  trill export log.mcap --ros2                          writes log-ros2.mcap
  trill export --topics 'camera/*,plant/state' log.mcap
"""
VIEW = """Open a log in Rerun: robot in 3D, both cameras, set-points, joints, controller states,
errors, ages of the inputs and events on one time line. Needs Rerun: pip install '.[view]'
in a checkout (170 MB).

The converted log is kept beside the log (log-view.rrd) and used again next time. Rerun's usage
statistics are off; in a browser the page can communicate with this machine only."""
VIEW_EXAMPLES = """examples:
  trill view runs/20260131-120000                       in a window; without a display as --web
  trill view runs/20260131-120000 --web --port 9090     in a browser, at the address it prints
  ssh -L 9090:127.0.0.1:9090 robot                      to view from another machine
"""
_EXPORT_PACKAGES = ("foxglove_schemas_protobuf", "rosbags", "cv2")


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill export``."""
    add_log_argument(parser)
    parser.add_argument(
        "-o", "--out", type=Path, help="file to write (<log>-exported.mcap beside the log)"
    )
    parser.add_argument(
        "--ros2", action="store_true", help="messages of ROS 2 only (to <log>-ros2.mcap)"
    )
    parser.add_argument(
        "--topics",
        type=parse_patterns,
        default=(),
        metavar="PATTERNS",
        help="only these topics, without the robot's name, separated by commas or blanks, e.g. "
        "'camera/*,plant/state'",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing file")


def export(arguments: argparse.Namespace) -> int:
    """Convert a log; return exit code 0 also if some topics were left out."""
    require("trill export", "export", *_EXPORT_PACKAGES)
    from lab.progress import ProgressBar
    from services.logger.export.convert import export_log

    log = chosen_log(arguments.log, tell=False)
    end = "ros2" if arguments.ros2 else "exported"
    out = arguments.out or log.with_name(f"{log.stem}-{end}.mcap")
    with ProgressBar("converting") as bar:
        summary = export_log(
            log,
            out,
            topics=arguments.topics,
            force=arguments.force,
            ros2=arguments.ros2,
            on_progress=bar.show,
        )
    print("\n".join(summary_lines(summary)))
    return 0


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill view``."""
    add_log_argument(parser)
    parser.add_argument("--web", action="store_true", help="serve it to a browser on this machine")
    parser.add_argument("--port", type=int, default=0, help="port for --web (any free one)")
    parser.add_argument(
        "--fresh", action="store_true", help="convert again, even if the log is unchanged"
    )


def view(arguments: argparse.Namespace) -> int:
    """Open a log in Rerun; return the viewer's exit code."""
    require("trill view", "view", "rerun", *_EXPORT_PACKAGES)
    from lab.progress import ProgressBar
    from services.logger.view import rerun

    with ProgressBar("converting") as bar:
        path, summary = rerun.prepare(
            chosen_log(arguments.log), fresh=arguments.fresh, on_progress=bar.show
        )
    if summary is not None:
        print("\n".join(_remarks(summary)))
    print(f"recording      {path}")
    if arguments.web or not rerun.has_display():
        rerun.show_in_browser(path, arguments.port, _print_address)
        return 0
    return rerun.show(path)


def summary_lines(summary: "Summary") -> list[str]:
    """Return what was written, from what, and what was left out and why."""
    written = summary.written
    width = max(len(topic) for topic in written)
    lines = [f"  {topic:<{width}} {written[topic]:>8}" for topic in sorted(written)]
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


def _print_address(url: str) -> None:
    print(f"open           {url}\nCtrl-C ends it", flush=True)


EXPORT_ACTION = Action(EXPORT, EXPORT_EXAMPLES, add_export_arguments, export)
VIEW_ACTION = Action(VIEW, VIEW_EXAMPLES, add_view_arguments, view)
