"""Index what happened in a run by its ground truth. Pure.

Every event is placed at the newest ground truth that had arrived before it.
"""

from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any

from common.operator.holds import HoldBook
from common.robot.pose import Pose2
from common.schemas import (
    AuthorityState,
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
    StepJournal,
    TaskStatus,
)
from common.topics import PLANT_TRUTH, Topic
from lab.live.new_trials import preceded_first_operator
from lab.review.image_series import ImageSeries
from lab.review.message_spool import MessageSpool
from lab.review.scoring import commanded_motions, recorded_motions

RATE = 12.5
"""Ground truth is thinned to this rate [Hz]."""
MAX_TRUTH = 30_000
"""Ground truths kept, 40 minutes; of a longer run every other one is dropped, again and again."""


@dataclass(frozen=True)
class Section:
    """The span of ground truth during which the operator's label did not change."""

    start: int
    end: int
    label: str


@dataclass(frozen=True)
class GaitSpan:
    """The span of ground truth from the acceptance of a gait to its completion."""

    start: int
    end: int
    gait: Gait

    @property
    def name(self) -> str:
        """Name of the gait, for instance ``turn left``."""
        return self.gait.name.lower().replace("_", " ")


@dataclass
class Timeline:
    """Ground truth of a run in order of arrival, and its events by their index in ``truth``.

    Attributes:
        truth: the ground truth.
        scene_states: state of the scene's objects at each ground truth, before the first one was
            received that one; empty if there is none.
        labels: (index, label) at each change of the operator's label.
        gaits: the completed gaits.
        fall: index of the first fall; None without one.
        handovers: (index, text) where an operator took over from a policy or gave back to one.
        left_images: those of the robot's left camera.
        right_images: those of the robot's right camera.
        task_changes: (index, status) at each change of the scored task; trials that passed
            before an operator came are left out.
        operator_script: name of the script that the operator reported last.
        commanded: motion that each gait should make by the recorded settings of the controller,
            or by its default configuration where the log has none.
    """

    truth: MessageSpool[PlantState] = field(default_factory=partial(MessageSpool, PlantState))
    scene_states: MessageSpool[SceneState] = field(
        default_factory=partial(MessageSpool, SceneState)
    )
    labels: list[tuple[int, str]] = field(default_factory=list)
    gaits: list[GaitSpan] = field(default_factory=list)
    fall: int | None = None
    handovers: list[tuple[int, str]] = field(default_factory=list)
    left_images: ImageSeries = field(default_factory=ImageSeries)
    right_images: ImageSeries = field(default_factory=ImageSeries)
    task_changes: list[tuple[int, TaskStatus]] = field(default_factory=list)
    operator_script: str = ""
    commanded: dict[Gait, Pose2] = field(default_factory=commanded_motions)

    _last: PlantState | None = None
    """Last ground truth kept or, after a thinning, dropped."""
    _scene_state: SceneState | None = None
    _accepted: dict[tuple[int, int], int] = field(default_factory=dict)
    """Index of the acceptance of each gait under way, by boot id of its requester and number."""
    _period: float = 1.0 / RATE
    """Robot time between two ground truths [s]."""
    _seconds: "array[float]" = field(default_factory=lambda: array("d"))
    """Robot time at each ground truth [s]."""
    _book: HoldBook = field(default_factory=HoldBook)
    _unattended: set[tuple[int, int]] = field(default_factory=set)
    """Trials that passed before an operator came."""

    def add(self, topic: Topic[Any], message: Message) -> None:
        """Add the next message."""
        now = len(self.truth) - 1
        match message:
            case PlantState():
                due = topic.name == PLANT_TRUTH.name
                if due and _is_due(self._last, message, self._period):
                    self._add_truth(message)
            case SceneState():
                if self._scene_state is None:
                    for _ in self._seconds:
                        self.scene_states.append(message)
                self._scene_state = message
            case StepJournal():
                self.commanded = recorded_motions(message) or self.commanded
            case _ if now >= 0:
                self._add_event(message, now)

    def added(
        self, messages: Iterable[tuple[Topic[Any], Message]]
    ) -> Iterator[tuple[Topic[Any], Message]]:
        """Yield ``messages``, in order of arrival, after adding each."""
        for topic, message in messages:
            self.add(topic, message)
            yield topic, message

    def _add_truth(self, state: PlantState) -> None:
        passed = _seconds_between(self._last, state) if self._last else 0.0
        self._seconds.append((self._seconds[-1] if self._seconds else 0.0) + passed)
        self.truth.append(state)
        self._last = state
        if self._scene_state is not None:
            self.scene_states.append(self._scene_state)
        if len(self.truth) > MAX_TRUTH:
            self._thin()

    def _add_event(self, message: Message, now: int) -> None:
        match message:
            case OperatorStatus():
                self.operator_script = message.script
                if message.label and message.label != self.label_at(now):
                    self.labels.append((now, message.label))
            case GaitReply(outcome=GaitOutcome.ACCEPTED):
                # A request that is sent again while its gait is under way is accepted again.
                self._accepted.setdefault((message.requester_boot, message.request_id), now)
            case GaitReply(outcome=GaitOutcome.COMPLETED):
                start = self._accepted.pop((message.requester_boot, message.request_id), None)
                if start is not None:
                    self.gaits.append(GaitSpan(start, now, message.gait))
            case PlantStatus(fallen=True) if self.fall is None:
                self.fall = now
            case CameraFrame():
                images = self.left_images if message.eye == "left" else self.right_images
                images.add(now, message)
            case AuthorityState() if self._book.observe(message, now):
                if self._book.handover:
                    self.handovers.append((now, self._book.handover))
            case TaskStatus() if trial_of(message) not in self._unattended:
                if self.task is None or _task_state(self.task) != _task_state(message):
                    self.task_changes.append((now, message))
            case PlantRequest() if self.task and preceded_first_operator(message, self.task):
                self._unattended.add(trial_of(self.task))
                self.task_changes = [
                    change
                    for change in self.task_changes
                    if trial_of(change[1]) not in self._unattended
                ]

    def _thin(self) -> None:
        """Drop every other ground truth; what was at one is then at the one before it."""
        self._period *= 2.0
        self.truth, self.scene_states = self.truth[::2], self.scene_states[::2]
        self._seconds = self._seconds[::2]
        self.labels = [(index // 2, label) for index, label in self.labels]
        self.gaits = [GaitSpan(one.start // 2, one.end // 2, one.gait) for one in self.gaits]
        self.fall = None if self.fall is None else self.fall // 2
        self.handovers = [(index // 2, text) for index, text in self.handovers]
        self.left_images.halve_indices()
        self.right_images.halve_indices()
        self.task_changes = [(index // 2, status) for index, status in self.task_changes]
        self._accepted = {request: index // 2 for request, index in self._accepted.items()}

    @property
    def scene(self) -> str:
        """Name of the scene around the robot."""
        return self.scene_states[0].scene if self.scene_states else "flat"

    @property
    def task(self) -> TaskStatus | None:
        """Last status of the scored task; None without a task."""
        return self.task_changes[-1][1] if self.task_changes else None

    def scene_states_at(self, indices: Iterable[int]) -> Iterator[SceneState | None]:
        """Yield the scene at each index; None if none was received."""
        for index in indices:
            yield self.scene_states[index] if self.scene_states else None

    def seconds_at(self, index: int) -> float:
        """Return the robot time from the first ground truth to that at ``index`` [s].

        It goes on where the plant was restarted or reset.
        """
        return self._seconds[index]

    def label_at(self, index: int) -> str:
        """Return the operator's label at ``index``; empty before the first one."""
        position = bisect_right([start for start, _ in self.labels], index) - 1
        return self.labels[position][1] if position >= 0 else ""

    def sections(self) -> list[Section]:
        """Split the run at the changes of label; one unnamed section if there are none."""
        last = len(self.truth) - 1
        starts = [*self.labels, (last, "")]
        if len(starts) == 1:
            return [Section(0, last, "")]
        return [
            Section(start, max(start, following - 1), label)
            for (start, label), (following, _) in pairwise(starts)
        ]


def trial_of(status: TaskStatus) -> tuple[int, int]:
    """Identify a trial: by the boot id of the plant and the number of its resets."""
    return status.header.boot, status.reset_count


def read_timeline(messages: Iterable[tuple[Topic[Any], Message]]) -> Timeline:
    """Build the timeline of a run from its messages in order of arrival."""
    timeline = Timeline()
    for topic, message in messages:
        timeline.add(topic, message)
    return timeline


def _task_state(status: TaskStatus) -> tuple[object, ...]:
    """Return the parts of a status whose change is an event."""
    done = tuple(stage.done for stage in status.stages)
    return (
        *(status.task, status.seed, trial_of(status), status.time > 0.0, done),
        *(len(status.undesired), status.verdict),
    )


def _seconds_between(before: PlantState, state: PlantState) -> float:
    """Return the robot time from one ground truth to the next [s]; 0 if it began anew."""
    if (before.header.boot, before.reset_count) != (state.header.boot, state.reset_count):
        return 0.0
    return 1e-9 * (state.header.stamp - before.header.stamp)


def _is_due(last: PlantState | None, message: PlantState, period: float) -> bool:
    """Return whether a ``period`` [s] has passed, or robot time began anew."""
    if last is None or message.header.boot != last.header.boot:
        return True
    elapsed = (message.header.stamp - last.header.stamp) * 1e-9
    return elapsed < 0.0 or elapsed >= 0.95 * period


def frame_step(timeline: Timeline, most: int) -> int:
    """Return n so that every n-th ground truth makes a video of at most ``most`` frames."""
    return max(1, -(-len(timeline.truth) // most))
