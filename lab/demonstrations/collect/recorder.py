"""Records the frames of a trial, see :mod:`lab.demonstrations.frames`."""

from collections.abc import Mapping, Sequence

from common.operator.holds import HoldBook
from common.schemas import (
    AuthorityState,
    CameraFrame,
    Setpoint,
    TaskStatus,
    TaskVerdict,
)
from common.topics import (
    PLANT_STATE,
    TASK_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_AUTHORITY,
    WBC_STATE,
)
from lab.demonstrations.collect.pictures import PictureInput
from lab.demonstrations.frames import EpisodeFrames, Moment, Picture
from lab.trials.stack import TaskStack
from services.sim.model.world import scene_names


class EpisodeRecorder:
    """Records one trial.

    There is no frame before the robot's first measurements and the first pictures have arrived.

    Attributes:
        frames: the frames so far; their pictures are referred to by when they were taken.
        names: names of the columns that depend on the scene, by path.
        verdict_frame: first frame after the judge's verdict; -1: there is none yet.
    """

    def __init__(self, stack: TaskStack, pictures: PictureInput, *, operators: int = 1) -> None:
        """Subscribe to the messages of a trial that has not begun.

        Args:
            stack: the trial.
            pictures: takes in its pictures.
            operators: how many may operate the robot in turn.
        """
        holds = HoldBook() if operators > 1 else None
        self.frames: EpisodeFrames[int] = EpisodeFrames(holds)
        self.verdict_frame = -1
        self._plant = plant = stack.plant.plant
        self._pictures = pictures
        self.names: Mapping[str, Sequence[str]] = {
            "truth/scene_qpos": scene_names(plant.model, plant.addresses)
        }
        runner = stack.runner
        self._state = runner.newest(PLANT_STATE)
        self._controller = runner.newest(WBC_STATE)
        self._operator = runner.newest(TELEOP_STATUS)
        runner.on_message(TELEOP_SETPOINT, self._on_setpoint)
        runner.on_message(TELEOP_GAIT, self.frames.gait)
        runner.on_message(TASK_STATUS, self._on_task_status)
        if holds is not None:
            pictures.on_step = self._on_tick

            def follow(state: AuthorityState) -> None:
                holds.observe(state, state.since)

            runner.on_message(WBC_AUTHORITY, follow)

    def _on_task_status(self, status: TaskStatus) -> None:
        if status.verdict is not TaskVerdict.RUNNING and self.verdict_frame < 0:
            self.verdict_frame = len(self.frames)

    def _on_setpoint(self, setpoint: Setpoint) -> None:
        moment = self._moment()
        if moment is not None:
            self.frames.setpoint(setpoint, moment)

    def _on_tick(self) -> None:
        moment = self._moment() if self.frames.is_due(self._plant.now_ns) else None
        if moment is not None:
            self.frames.tick(moment)

    def _moment(self) -> Moment[int] | None:
        state, controller, picture = self._state(), self._controller(), self._pictures.newest
        if state is None or controller is None or picture is None:
            return None
        plant = self._plant
        truth = plant.truth(), plant.view.state(plant.now_ns, plant.reset_count)
        status = self._operator()
        slipping = status is not None and status.slipping
        return Moment(plant.now_ns, state, controller, _stamped(picture), truth, slipping)


def _stamped(picture: CameraFrame) -> Picture[int]:
    return Picture(picture.header.stamp, picture.header.stamp)
