"""What pictures of a run are made from, and which moments deserve one. Pure.

Everything is placed in robot time by the newest ground truth that had arrived with it.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.robot.joints import LEFT_ARM, RIGHT_ARM
from common.schemas import (
    CameraFrame,
    Gait,
    GaitOutcome,
    GaitReply,
    Message,
    OperatorStatus,
    PlantRequest,
    PlantState,
    PlantStatus,
    SceneState,
    TaskStatus,
)
from common.topics import PLANT_TRUTH, Topic
from lab.live.new_trials import preceded_first_operator

RATE = 12.5
"""Ground truth is thinned to this [Hz], so that hours of it fit in memory."""
MOST_PICTURES = 2000
"""Kept of each eye; of more, every other is let go, time and again."""
SWING_SHARE = 0.55
"""Part of a gait at which a foot is well in the air."""


@dataclass(frozen=True)
class Moment:
    """One picture of the contact sheet: ground truth number ``index`` under ``label``."""

    index: int
    label: str


@dataclass(frozen=True)
class Section:
    """What the operator called the time from ground truth ``start`` up to ``end``."""

    start: int
    end: int
    label: str


@dataclass(frozen=True)
class Stride:
    """A gait from acceptance to its end, as indices of ground truth."""

    start: int
    end: int
    gait: Gait

    @property
    def name(self) -> str:
        """The gait in words."""
        return self.gait.name.lower().replace("_", " ")


@dataclass
class Film:
    """Ground truth in order, and what went on meanwhile; numbers are indices into ``truth``.

    ``left`` and ``right`` hold (index, picture) of the robot's eyes, ``scenes`` where the scene's
    things were at each ground truth, ``news`` (index, status) of the task when it had changed,
    ``script`` what the operator said it was playing last, ``idle`` the trials (as of
    :func:`trial_of`) that ran before an operator came.
    """

    truth: list[PlantState] = field(default_factory=list)
    labels: list[tuple[int, str]] = field(default_factory=list)
    strides: list[Stride] = field(default_factory=list)
    fell: int | None = None
    left: list[tuple[int, CameraFrame]] = field(default_factory=list)
    right: list[tuple[int, CameraFrame]] = field(default_factory=list)
    scenes: list[SceneState | None] = field(default_factory=list)
    news: list[tuple[int, TaskStatus]] = field(default_factory=list)
    script: str = ""
    idle: set[tuple[int, int]] = field(default_factory=set)

    @property
    def scene(self) -> str:
        """What stands around the robot."""
        return next((things.scene for things in self.scenes if things is not None), "flat")

    @property
    def task(self) -> TaskStatus | None:
        """How the task stood last; None: there is none."""
        return self.news[-1][1] if self.news else None

    def things(self, indices: Iterable[int]) -> list[SceneState | None]:
        """Where the scene's things were; before they were heard, where they were first."""
        first = next((things for things in self.scenes if things is not None), None)
        # A film made by hand may know of none.
        return [self.scenes[i] or first if i < len(self.scenes) else first for i in indices]

    def seconds(self, index: int) -> float:
        """Robot time of a ground truth since the first [s]."""
        return (self.truth[index].header.stamp - self.truth[0].header.stamp) * 1e-9

    def label_at(self, index: int) -> str:
        """What the operator was doing then; empty before the first label."""
        position = bisect_right([start for start, _ in self.labels], index) - 1
        return self.labels[position][1] if position >= 0 else ""

    def sections(self) -> list[Section]:
        """The operator's labels, each up to the next; one unnamed section without labels."""
        last = len(self.truth) - 1
        starts = [*self.labels, (last, "")]
        if len(starts) == 1:
            return [Section(0, last, "")]
        return [
            Section(start, max(start, following - 1), label)
            for (start, label), (following, _) in pairwise(starts)
        ]


def trial_of(status: TaskStatus) -> tuple[int, int]:
    """Which trial is meant: a life of the plant, and its resets."""
    return status.header.boot, status.reset_count


def gather(messages: Iterable[tuple[Topic[Any], Message]]) -> Film:
    """Collect a film from a run's messages in the order they arrived."""
    film = Film()
    started: dict[int, int] = {}
    things: SceneState | None = None
    for topic, message in messages:
        now = len(film.truth) - 1
        if isinstance(message, PlantState):
            if topic.name == PLANT_TRUTH.name and _is_due(film.truth, message):
                film.truth.append(message)
                film.scenes.append(things)
        elif isinstance(message, SceneState):
            things = message
        elif now >= 0:
            _take(film, started, now, message)
    return film


def _take(film: Film, started: dict[int, int], now: int, message: Message) -> None:
    """Note what is not ground truth; ``started`` are the gaits under way by request id."""
    if isinstance(message, OperatorStatus):
        film.script = message.script
        if message.label and (not film.labels or film.labels[-1][1] != message.label):
            film.labels.append((now, message.label))
    elif isinstance(message, GaitReply):
        if message.outcome is GaitOutcome.ACCEPTED:
            # Said again to a request that is sent again, when the gait is under way.
            started.setdefault(message.request_id, now)
        elif message.outcome is GaitOutcome.COMPLETED and message.request_id in started:
            start = started.pop(message.request_id)
            film.strides.append(Stride(start, now, message.gait))
    elif isinstance(message, PlantStatus):
        if message.fallen and film.fell is None:
            film.fell = now
    elif isinstance(message, CameraFrame):
        reel = film.left if message.eye == "left" else film.right
        reel.append((now, message))
        if len(reel) > MOST_PICTURES:
            del reel[1::2]
    elif isinstance(message, TaskStatus) and trial_of(message) not in film.idle:
        if not film.news or _standing(film.news[-1][1]) != _standing(message):
            film.news.append((now, message))
    elif (
        isinstance(message, PlantRequest)
        and film.task
        and preceded_first_operator(message, film.task)
    ):
        film.idle.add(trial_of(film.task))
        film.news = [(at, news) for at, news in film.news if trial_of(news) not in film.idle]


def _standing(status: TaskStatus) -> tuple[object, ...]:
    """What is news when it changes."""
    done = tuple(stage.done for stage in status.stages)
    return (
        *(status.task, status.seed, trial_of(status), status.time > 0.0, done),
        *(len(status.undesired), status.verdict),
    )


def _is_due(truth: Sequence[PlantState], message: PlantState) -> bool:
    """Whether it is time for another ground truth, or robot time jumped back (a reset)."""
    if not truth:
        return True
    elapsed = (message.header.stamp - truth[-1].header.stamp) * 1e-9
    return elapsed < 0.0 or elapsed >= 0.95 / RATE


def moments(film: Film, spare: int = 6) -> list[Moment]:
    """The moments worth a picture, in order of time.

    Of a section with gaits, the first time each type of gait is seen, mid swing; of any other,
    when arms and grippers had moved furthest. ``spare`` evenly spaced ones are added
    when the operator labelled nothing. A fall is always shown.
    """
    if not film.truth:
        return []
    chosen: list[Moment] = []
    seen: set[str] = set()
    for section in film.sections():
        strides = [s for s in film.strides if section.start <= s.start <= section.end]
        for stride in strides:
            if stride.name not in seen:
                seen.add(stride.name)
                middle = stride.start + round(SWING_SHARE * (stride.end - stride.start))
                chosen.append(Moment(middle, stride.name))
        if not strides and section.label:
            chosen.append(Moment(_telling(film.truth, section), section.label))
    if not film.labels:
        last = len(film.truth) - 1
        chosen += [Moment(last * number // spare, "") for number in range(spare + 1)]
    if film.fell is not None:
        chosen.append(Moment(film.fell, "FELL"))
    unique = {moment.index: moment for moment in chosen}
    return [unique[index] for index in sorted(unique)]


def _telling(truth: Sequence[PlantState], section: Section) -> int:
    """When the arms and grippers were furthest from how the section found them; else its end."""
    found = _posture(truth[section.start])
    away = [
        float(np.linalg.norm(_posture(state) - found))
        for state in truth[section.start : section.end + 1]
    ]
    # Of equals the last: a section in which nothing moves is shown at its end.
    return section.end - int(np.argmax(np.round(away[::-1], 3)))


def _posture(state: PlantState) -> NDArray[np.float64]:
    """Arm joints [rad] and grippers, whose full stroke counts as much as two radians."""
    arms = state.joint_position[np.r_[LEFT_ARM, RIGHT_ARM]]
    return np.concatenate([arms, 2.0 * state.gripper_closure])


def frame_step(film: Film, most: int) -> int:
    """Every how many-th ground truth a video of at most ``most`` pictures shows."""
    return max(1, -(-len(film.truth) // most))


def picture_at(pictures: Sequence[tuple[int, CameraFrame]], index: int) -> CameraFrame | None:
    """The last picture taken by then; None before the first."""
    position = bisect_right([number for number, _ in pictures], index) - 1
    return pictures[position][1] if position >= 0 else None
