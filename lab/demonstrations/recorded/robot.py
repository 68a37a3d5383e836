"""Follows a log: what is newest of the robot at each of its messages; pure."""

from typing import Any

from common.episodes.columns import CAMERAS
from common.operator.holds import HoldBook
from common.schemas import (
    AuthorityState,
    CameraFrame,
    ControllerState,
    LinkChange,
    Message,
    PlantState,
    PolicyState,
    SceneState,
    Sender,
)
from common.topics import PLANT_STATE, PLANT_TRUTH, Topic
from lab.demonstrations.frames import Moment, Picture

Pair = tuple[CameraFrame, CameraFrame]
"""Pictures of the left and the right camera."""
_LONGEST_STEP_NS = 50_000_000
"""Longer than that after a state robot time is not known to have gone on [ns]."""
_KEPT_PICTURES = 20
"""Pictures of one camera that wait for the other's."""


class RecordedRobot:
    """What is newest of the robot, as a recorder beside it heard it.

    Attributes:
        holds: who has the robot.
        has_cameras: whether the log has pictures.
        trial: the plant's run and its number of resets; None: it has not been heard of.
        checkpoints: digest of each policy's checkpoint.
        links: delays injected into links, by reader and topic.
    """

    def __init__(self, *, has_cameras: bool) -> None:
        self.holds = HoldBook()
        self.has_cameras = has_cameras
        self.trial: tuple[int, int] | None = None
        self.checkpoints: dict[Sender, str] = {}
        self.links: dict[str, str] = {}
        self._state: PlantState | None = None
        self._state_ns = 0
        self._controller: ControllerState | None = None
        self._picture: Picture[Pair] | None = None
        self._single: dict[str, dict[int, CameraFrame]] = {camera: {} for camera in CAMERAS}
        self._scene: SceneState | None = None
        self._truth: tuple[PlantState, SceneState] | None = None

    def hear(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        """Take in a message that arrived at ``at_ns`` on the recording's clock."""
        match message:
            case PlantState() if topic.name == PLANT_STATE.name:
                self._hear_state(message, at_ns)
            case PlantState() if topic.name == PLANT_TRUTH.name:
                # The scene, if it moves, was published just before.
                if self._scene is not None and self._scene.header.stamp == message.header.stamp:
                    self._truth = message, self._scene
            case SceneState():
                self._scene = message
            case ControllerState():
                self._controller = message
            case CameraFrame():
                self._hear_picture(message)
            case AuthorityState():
                self.holds.observe(message, at_ns)
            case PolicyState():
                self.checkpoints[message.header.sender] = message.checkpoint
            case LinkChange():
                name = f"{message.service}:{message.topic}"
                self.links.pop(name, None)
                self.links |= {name: message.link} if message.link else {}

    def now_ns(self, at_ns: int) -> int:
        """Return the robot time at an arrival; 0 before the first state [ns]."""
        if self._state is None:
            return 0
        elapsed = min(max(0, at_ns - self._state_ns), _LONGEST_STEP_NS)
        return self._state.header.stamp + elapsed

    def moment(self, at_ns: int) -> Moment[Pair] | None:
        """Return what is newest at an arrival; None while something is missing."""
        if self._state is None or self._controller is None:
            return None
        if self.has_cameras and self._picture is None:
            return None
        now = self.now_ns(at_ns)
        return Moment(now, self._state, self._controller, self._picture, self._truth)

    def _hear_state(self, state: PlantState, at_ns: int) -> None:
        trial = state.header.boot, state.reset_count
        if trial != self.trial:
            # What was heard before is of another time.
            self.trial = trial
            self._picture = self._truth = self._scene = self._controller = None
            for single in self._single.values():
                single.clear()
        self._state, self._state_ns = state, at_ns

    def _hear_picture(self, frame: CameraFrame) -> None:
        other = self._single["right" if frame.eye == "left" else "left"].get(frame.header.stamp)
        if other is not None:
            pair = (frame, other) if frame.eye == "left" else (other, frame)
            self._picture = Picture(frame.header.stamp, pair)
            return
        single = self._single[frame.eye]
        single[frame.header.stamp] = frame
        if len(single) > _KEPT_PICTURES:
            del single[next(iter(single))]
