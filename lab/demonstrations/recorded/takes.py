"""Cuts a log into takes: attempts at a task, with their frames and their outcome; pure.

A take is what lies between two marks (`trill mark`), or, in a recording without marks, a trial of
the scored task: from the first set-point until half a second after the judge's verdict.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from common.episodes.episode_file import PERIOD_NS
from common.schemas import (
    EpisodeAction,
    EpisodeMark,
    GaitRequest,
    Message,
    PlantState,
    Sender,
    Setpoint,
    TaskStatus,
    TaskVerdict,
)
from common.topics import PLANT_STATE, Topic
from lab.demonstrations.frames import EpisodeFrames
from lab.demonstrations.recorded.robot import Pair, RecordedRobot
from lab.trials.stack import SECONDS_AFTER_VERDICT

Arrived = tuple[Topic[Any], Message, int]
"""A message with its topic and its arrival on the recording's clock [ns]."""


@dataclass
class Take:
    """One attempt at a task.

    Attributes:
        trial: the plant's run and its number of resets.
        frames: of the take.
        start_ns: arrival of its first set-point [ns].
        mark: number of the marked episode; None: the recording has no marks.
        label: of the mark.
        outcome: how the mark ended it; None: it did not.
        status: the judge's last status; None: there is no judge.
        verdict_frame: first frame after the verdict; -1: there is no verdict.
        end_ns: arrival of the verdict or the end mark; 0: neither came.
        checkpoints: digests of the policies that operated the robot, by their runs.
        links: delays that were injected, by reader and topic.
    """

    trial: tuple[int, int]
    frames: EpisodeFrames[Pair]
    start_ns: int
    mark: int | None = None
    label: str = ""
    outcome: EpisodeAction | None = None
    status: TaskStatus | None = None
    verdict_frame: int = -1
    end_ns: int = 0
    checkpoints: dict[Sender, str] = field(default_factory=dict)
    links: dict[str, str] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Length [s]."""
        stamps = self.frames.rows.rows["time/robot_ns"]
        return 1e-9 * (stamps[-1] - stamps[0]) if stamps else 0.0  # type: ignore[operator]

    @property
    def has_gaps(self) -> bool:
        """Whether frames are missing, because the log lacks messages."""
        stamps: list[Any] = self.frames.rows.rows["time/robot_ns"]
        return any(after - before >= 2 * PERIOD_NS for before, after in pairwise(stamps))


class _Cutter:
    """Builds the takes of one recording."""

    def __init__(self, *, has_cameras: bool, has_marks: bool) -> None:
        self._robot = RecordedRobot(has_cameras=has_cameras)
        self._has_marks = has_marks
        self._mark: EpisodeMark | None = None
        """The start of the marked episode that is open."""
        self._take: Take | None = None
        self._over: set[tuple[int, int]] = set()
        """Trials of which the take has ended."""

    def hear(self, topic: Topic[Any], message: Message, at_ns: int) -> Iterator[Take]:
        """Take in the next message; yield a take that has ended."""
        before = self._robot.trial
        self._robot.hear(topic, message, at_ns)
        if self._robot.trial != before:
            yield from self.end()
        match message:
            case PlantState() if topic.name == PLANT_STATE.name:
                yield from self._tick(at_ns)
            case Setpoint():
                self._on_setpoint(message, at_ns)
            case GaitRequest() if self._take is not None and self._acts(message.header.sender):
                self._take.frames.gait(message)
            case TaskStatus() if self._take is not None:
                self._on_status(self._take, message, at_ns)
            case EpisodeMark():
                yield from self._on_mark(message, at_ns)

    def end(self) -> Iterator[Take]:
        """Yield the take that is open, which has ended."""
        take, self._take = self._take, None
        if take is not None and len(take.frames):
            self._over.add(take.trial)
            yield take

    def _acts(self, sender: Sender) -> bool:
        present = self._robot.holds.present
        return present is not None and present.holder == sender

    def _tick(self, at_ns: int) -> Iterator[Take]:
        take = self._take
        if take is None:
            return
        if take.frames.is_due(now_ns := self._robot.now_ns(at_ns)):
            moment = self._robot.moment(at_ns)
            if moment is not None:
                take.frames.tick(moment)
        stamps: list[Any] = take.frames.rows.rows["time/robot_ns"]
        if 0 <= take.verdict_frame < len(stamps) and not self._has_marks:
            after = now_ns - stamps[take.verdict_frame]
            if after >= 1e9 * SECONDS_AFTER_VERDICT:
                yield from self.end()

    def _on_setpoint(self, setpoint: Setpoint, at_ns: int) -> None:
        robot = self._robot
        moment = robot.moment(at_ns)
        if moment is None or robot.trial is None or not self._acts(setpoint.header.sender):
            return
        if self._take is None:
            wanted = self._mark is not None if self._has_marks else robot.trial not in self._over
            if not wanted:
                return
            self._take = Take(robot.trial, EpisodeFrames(robot.holds), at_ns)
            if self._mark is not None:
                self._take.mark, self._take.label = self._mark.episode, self._mark.label
        self._take.frames.setpoint(setpoint, moment)
        self._take.links = dict(robot.links)
        if (digest := robot.checkpoints.get(setpoint.header.sender)) is not None:
            self._take.checkpoints[setpoint.header.sender] = digest

    def _on_status(self, take: Take, status: TaskStatus, at_ns: int) -> None:
        running = take.status is None or take.status.verdict is TaskVerdict.RUNNING
        take.status = status
        if running and status.verdict is not TaskVerdict.RUNNING:
            take.verdict_frame, take.end_ns = len(take.frames), at_ns

    def _on_mark(self, mark: EpisodeMark, at_ns: int) -> Iterator[Take]:
        if mark.action is EpisodeAction.START:
            if self._mark is None or self._mark.episode != mark.episode:
                yield from self.end()
                self._mark = mark
        elif self._mark is not None and self._mark.episode == mark.episode:
            self._mark = None
            if self._take is not None:
                self._take.outcome, self._take.label = mark.action, mark.label or self._take.label
                self._take.end_ns = self._take.end_ns or at_ns
            yield from self.end()


def cut(messages: Iterable[Arrived], *, has_cameras: bool, has_marks: bool) -> Iterator[Take]:
    """Yield the takes in a recording's messages, which come in order of arrival.

    Args:
        messages: of the topics that :class:`_Cutter` and the robot listen to, at least.
        has_cameras: whether the recording has pictures.
        has_marks: whether it has marks of episodes, which then say what a take is.
    """
    cutter = _Cutter(has_cameras=has_cameras, has_marks=has_marks)
    for topic, message, at_ns in messages:
        yield from cutter.hear(topic, message, at_ns)
    yield from cutter.end()
