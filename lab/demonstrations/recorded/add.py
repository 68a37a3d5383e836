"""Adds the takes of recorded runs to a data set, as episodes like those of `trill collect`."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.columns import CAMERAS, RATE, Rows
from common.episodes.episode_file import EpisodeMeta, to_bytes
from common.episodes.errors import EpisodeError
from common.episodes.folder import IndexLine
from common.errors import ConfigError
from common.schemas import CameraFrame, EpisodeAction, TaskVerdict
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    EPISODE,
    LINK_CHANGE,
    PLANT_STATE,
    PLANT_TRUTH,
    POLICY_STATE,
    TASK_SCENE,
    TASK_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_STATE,
)
from common.wire.decoder import Decoders
from lab.demonstrations.collect.config import PACKAGES
from lab.demonstrations.collect.dataset import read_dataset
from lab.demonstrations.collect.store import DatasetStore
from lab.demonstrations.recorded.config import RecordedConfig
from lab.demonstrations.recorded.takes import Arrived, Take, cut
from lab.trials.provenance import CodeVersion, code_version
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.read.segments import recording_id
from services.policy.processor.actions import moving
from services.sim.model.world import build_model, find_addresses, scene_names
from services.sim.rendering.cameras import encode
from services.sim.tasks import find_task

_TOPICS = (
    *(PLANT_STATE, PLANT_TRUTH, TASK_SCENE, TASK_STATUS, WBC_STATE, WBC_AUTHORITY, EPISODE),
    *(CAMERA_LEFT, CAMERA_RIGHT, TELEOP_SETPOINT, TELEOP_GAIT, POLICY_STATE, LINK_CHANGE),
)
_REST = 0.5
"""Time before the first and after the last motion that is left by trimming [s]."""
_QUALITY = 90
DISCARDED = "discarded"
"""Verdict on a take that whoever recorded it did not want."""


@dataclass(frozen=True)
class AddOptions:
    """How takes become episodes.

    Attributes:
        task: of a recording without a judge; None: the judge's.
        mix: whether episodes of several kinds of operators may be in one data set.
        trim: whether rest at the beginning and the end is left out.
        keep_failures: whether episodes that are no success are kept too.
    """

    task: str | None = None
    mix: bool = False
    trim: bool = False
    keep_failures: bool = False


@dataclass
class Added:
    """What became of the takes of a recording; ``metas`` are the new trials."""

    metas: list[EpisodeMeta] = field(default_factory=list)
    known: int = 0
    """Takes that the data set had already."""


def recording_code() -> CodeVersion:
    """Return the version of the code that decides an episode's bytes."""
    return code_version("lab.demonstrations.recorded.add", packages=PACKAGES)


def add_run(
    log: Path,
    store: DatasetStore,
    options: AddOptions,
    advance: Callable[[float, float], None] = lambda _done, _all: None,
) -> Added:
    """Add the takes in a log to a data set, which is made if need be.

    Args:
        log: the first segment of a recording.
        store: the data set.
        options: how takes become episodes.
        advance: called now and then with the time read, and all of it [s].

    Raises:
        LoggerError: the log cannot be read.
        EpisodeError: it has no takes, or the data set cannot be written.
        ConfigError: the takes do not fit the data set.
    """
    info = read_info(log)
    for topic in (WBC_AUTHORITY, TELEOP_SETPOINT):
        if not any(one.key.endswith(topic.name) and one.messages for one in info.topics):
            raise EpisodeError(
                f"{log} has no {topic.name}: expected the recording of a run in which somebody "
                "operated the robot"
            )
    cameras = any("camera/" in one.key and one.messages for one in info.topics)
    takes = cut(
        _messages(log, info.seconds, advance),
        has_cameras=cameras,
        has_marks=bool(info.episodes),
    )
    about = {
        "run": log.parent.resolve().name,
        "log": log.name,
        "recording": recording_id(info.origin),
        "robot": info.origin.get("robot", ""),
    }
    added = Added()
    with store.locked():
        lines = _known(store)
        for take in takes:
            _add(take, about, store, options, lines, added)
    if not added.metas and not added.known:
        raise EpisodeError(
            f"{log} has no take of a task: expected set-points of an operator that had the robot, "
            "and states, controller and cameras (if there are any) at the same time"
        )
    return added


def _messages(
    log: Path, seconds: float, advance: Callable[[float, float], None]
) -> Iterator[Arrived]:
    reader, decoders, told = LogReader(log), Decoders(), 0.0
    for raw in reader.raw_messages(_TOPICS):
        assert raw.topic is not None
        message = decoders.decode(raw.key, raw.payload, raw.topic.schema, raw.tag or None)
        yield raw.topic, message, raw.time_ns
        done = 1e-9 * (raw.time_ns - (reader.start_ns or 0))
        if done > told + 0.5:
            told = done
            advance(done, seconds)


def _known(store: DatasetStore) -> list[IndexLine]:
    """Return what is in the data set, after its index was made to say the same."""
    if read_dataset(store.root) is None:
        return []
    lines = store.scan()
    store.write_index(lines)
    return lines


def _add(
    take: Take,
    about: dict[str, Any],
    store: DatasetStore,
    options: AddOptions,
    lines: list[IndexLine],
    added: Added,
) -> None:
    """Add one take to the data set, to ``lines`` and to ``added``; or count it as known."""
    recording = about | _identity(take)
    if any(_same_take(line.meta.recording, recording) for line in lines):
        added.known += 1
        return
    number = 1 + max((line.meta.seed for line in lines), default=-1)
    meta, span = _meta(take, recording, options, number)
    config = store.adding(
        RecordedConfig(
            task=meta.task,
            operators=(meta.operator,),
            picture_size=meta.picture_size,
            keep_failures=options.keep_failures,
        ),
        recording_code(),
        mix=options.mix,
    )
    meta = meta.model_copy(update={"origin": config.origin()})
    kept = meta.success or (options.keep_failures and meta.verdict in {"partial", "failure"})
    lines.append(store.add(meta, _content(take, meta, span) if kept else None))
    added.metas.append(meta)


def _identity(take: Take) -> dict[str, Any]:
    boot, resets = take.trial
    return {"plant_boot": boot, "resets": resets, "mark": take.mark}


def _same_take(one: dict[str, Any], other: dict[str, Any]) -> bool:
    names = ("recording", "log", "plant_boot", "resets", "mark")
    return bool(one) and all(one.get(name) == other[name] for name in names)


def _meta(
    take: Take, recording: dict[str, Any], options: AddOptions, number: int
) -> tuple[EpisodeMeta, slice]:
    """Return what describes a take as an episode, and which of its frames belong to it."""
    task = _task(take, options)
    verdict, reason = _verdict(take)
    span = _span(take, trim=options.trim)
    frames = span.stop - span.start
    code, size = recording_code(), _picture_size(take)
    begun = take.verdict_frame if take.verdict_frame >= 0 else len(take.frames)
    meta = EpisodeMeta(
        operator=take.frames.operator,
        task=task,
        goal=find_task(task).goal,
        seed=number,
        verdict=verdict,
        reason=reason[:400],
        completion_time=take.status.time if take.status else begun / RATE,
        verdict_frame=begun - span.start if verdict == "success" or take.verdict_frame >= 0 else -1,
        frames=frames,
        frame_tolerance=1e-9 * 2 * take.frames.worst_ns,
        picture_size=size,
        stages=tuple(s.name for s in take.status.stages if s.done) if take.status else (),
        gave_up="",
        origin={},
        recording=recording
        | {
            "label": take.label,
            "seed": take.status.seed if take.status else None,
            "links": take.links,
            "checkpoints": sorted(set(take.checkpoints.values())),
        },
        versions=code.versions,
        source=code.source,
        machine=code.machine,
    )
    return meta, span


def _task(take: Take, options: AddOptions) -> str:
    judged = take.status.task if take.status is not None else None
    if judged is None and options.task is None:
        raise ConfigError("the recording does not say which task was done: give --task")
    if options.task not in {None, judged} and judged is not None:
        raise ConfigError(f"--task is {options.task}, but the recording is of {judged}")
    return judged or options.task or ""


def _verdict(take: Take) -> tuple[str, str]:
    """Return the judge's verdict; without a judge that of whoever set the marks."""
    if take.outcome is EpisodeAction.DISCARD:
        return DISCARDED, f"discarded: {take.label}" if take.label else "discarded"
    if take.has_gaps:
        return "error", "frames are missing: the log lacks messages"
    if len({(left.width, left.height) for left, _ in take.frames.pictures}) > 1:
        return "error", "the size of the pictures changes"
    status = take.status
    if status is not None and status.verdict is not TaskVerdict.RUNNING:
        return status.verdict.name.lower(), status.reason
    if status is None and take.outcome is EpisodeAction.END:
        return "success", f"marked as done: {take.label}" if take.label else "marked as done"
    return "failure", "it was left before a verdict"


def _span(take: Take, *, trim: bool) -> slice:
    """Return the frames of the episode: all, or those from the first motion to the last."""
    whole = slice(0, len(take.frames))
    if not trim:
        return whole
    rows = take.frames.rows.rows
    hands, grasp = np.array(rows["action/hands"]), np.array(rows["action/grasp"])
    balanced = np.array(rows["observation/control_state"]) == 1
    active = np.flatnonzero(moving(hands, grasp) | ~balanced)
    if not len(active):
        return whole
    rest = round(_REST * RATE)
    last = max(int(active[-1]), take.verdict_frame)
    return slice(max(0, int(active[0]) - rest), min(whole.stop, last + rest + 1))


def _picture_size(take: Take) -> tuple[int, int] | None:
    if not take.frames.pictures:
        return None
    left, _ = take.frames.pictures[0]
    return left.width, left.height


def _content(take: Take, meta: EpisodeMeta, span: slice) -> bytes:
    rows = Rows({path: values[span] for path, values in take.frames.rows.rows.items()})
    pairs = take.frames.pictures[span]
    pictures = {
        camera: [_jpeg(pair[eye]) for pair in pairs] for eye, camera in enumerate(CAMERAS) if pairs
    }
    model = build_model(find_task(meta.task).scene)
    names = {"truth/scene_qpos": scene_names(model, find_addresses(model))}
    return to_bytes(meta, rows, pictures, names)


def _jpeg(frame: CameraFrame) -> bytes:
    if frame.encoding == "jpeg":
        return frame.data
    pixels = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3)
    return encode(pixels, "jpeg", _QUALITY)
