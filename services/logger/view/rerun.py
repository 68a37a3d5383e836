"""Opens a log in Rerun: converted, with the robot's shapes and a layout, kept beside the log."""

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from services.logger.export.convert import OnProgress, Summary, export_log
from services.logger.read.segments import existing_segments, find_segments

APPLICATION = "trill"
SUFFIX = "-view.rrd"
SETPOINT_RADIUS = 0.035
"""Radius of the spheres that show where the hands should be [m]."""
_SIDE_COLOURS = {"left": (78, 121, 167), "right": (242, 142, 43)}


def prepare(log: Path, *, fresh: bool, on_progress: OnProgress) -> tuple[Path, Summary | None]:
    """Convert ``log`` to a Rerun recording, or find the one made before.

    The recording lies beside the log, or in the temporary directory if that place cannot be
    written. It is made again when the log has grown, and for ``fresh``.

    Returns:
        the .rrd file, and what was converted; None if an earlier file is used.

    Raises:
        LoggerError: there is no readable log.
        ExportError: the log cannot be converted.
    """
    folder = log.parent if os.access(log.parent, os.W_OK) else Path(tempfile.gettempdir())
    path = folder / f"{log.stem}{SUFFIX}"
    if not fresh and _newer(path, existing_segments(log)):
        return path, None
    with tempfile.TemporaryDirectory(prefix="trill-view-", dir=folder) as work:
        exported = Path(work) / "exported.mcap"
        summary = export_log(log, exported, on_progress=on_progress)
        unfinished = Path(work) / path.name
        write_recording(
            exported, unfinished, name=f"{log.parent.name}/{log.stem}", identity=identity_of(log)
        )
        unfinished.replace(path)
    return path, summary


def identity_of(log: Path) -> str:
    """Return an identity of its own for a log: Rerun takes logs of one identity for the same."""
    first = find_segments(log)
    place = hashlib.sha256(str(first.paths[0].absolute()).encode()).hexdigest()[:16]
    return f"{first.recording or place}-{log.stem}"


def write_recording(exported: Path, path: Path, name: str, identity: str) -> None:
    """Write a file of :func:`export_log` as a Rerun recording, the .rrd file ``path``.

    It has robot shapes and layout; the viewer shows ``name`` and tells it from others by
    ``identity``.
    """
    import rerun as rr
    from rerun.chunk import McapReader, OptimizationProfile

    from services.logger.view.layout import blueprint

    # Heartbeats are many and show nothing that the ages of the links do not; the layout shows the
    # cameras' images by themselves.
    reader = McapReader(exported, exclude_topic_regex=["^/heartbeat/", "/camera_info$"])
    recording = rr.RecordingStream(APPLICATION, recording_id=identity)
    topics = [channel.topic for channel in reader.info().channels]
    recording.save(path, default_blueprint=blueprint(topics))
    recording.send_recording_name(name)
    _log_shapes(recording)
    # The importer makes thousands of small chunks, which browsers take a minute to swallow.
    store = reader.stream().collect(optimize=OptimizationProfile.LIVE)
    rr.send_chunks(store, recording=recording)
    recording.flush()
    recording.disconnect()


def show(path: Path) -> int:
    """Open the native viewer and wait until it is closed; returns its exit code."""
    return subprocess.run([*_COMMAND, str(path)], env=_environment(), check=False).returncode


def show_in_browser(path: Path, port: int, on_address: Callable[[str], None]) -> None:
    """Serve the recording and the web viewer on this machine until interrupted.

    ``on_address`` is called with the address to open; port 0 takes any free one.

    Raises:
        ExportError: the port is taken, or Rerun does not work.
    """
    from services.logger.view.webview import RECORDING, address_of, fetch_viewer, web_server

    with tempfile.TemporaryDirectory(prefix="trill-view-") as work:
        folder = Path(work)
        with web_server(folder, port) as server:
            fetch_viewer(folder, _COMMAND, _environment())
            (folder / RECORDING).symlink_to(path.absolute())
            on_address(address_of(server))
            server.serve_forever()


def has_display() -> bool:
    """Whether a window could be opened here."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


_COMMAND = (sys.executable, "-m", "rerun_cli")


def _environment() -> dict[str, str]:
    # With CI set Rerun sends no usage statistics, whatever is configured.
    return {**os.environ, "CI": "1"}


def _newer(path: Path, segments: list[Path]) -> bool:
    if not path.exists() or not all(one.exists() for one in segments):
        return False
    return path.stat().st_mtime > max(one.stat().st_mtime for one in segments)


def _log_shapes(recording: "rr.RecordingStream") -> None:  # type: ignore[name-defined] # noqa: F821
    """Log the robot's shapes in the frames of its links, and spheres for the set-points."""
    import rerun as rr

    from services.logger.export.robot import RobotModel

    for side, colour in _SIDE_COLOURS.items():
        mark = rr.Ellipsoids3D(
            half_sizes=[[SETPOINT_RADIUS] * 3],
            colors=[colour],
            fill_mode=rr.components.FillMode.Solid,
        )
        recording.log(f"/hands/{side}/setpoint", mark, static=True, strict=True)
    try:
        meshes = RobotModel().meshes()
    except ImportError:  # noted in the summary already
        return
    for number, mesh in enumerate(meshes):
        corners, normals = mesh.faceted()
        recording.log(
            f"/robot/{mesh.link}/{number}",
            rr.CoordinateFrame(mesh.link),
            rr.Mesh3D(
                vertex_positions=corners,
                vertex_normals=normals,
                albedo_factor=[round(255 * part) for part in mesh.colour],
            ),
            static=True,
            strict=True,
        )
