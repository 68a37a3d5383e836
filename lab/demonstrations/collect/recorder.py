"""Records the frames of a trial, twenty times a second.

Each set-point of the operator makes one frame. Its measurements are the newest that the robot had
at that moment, its pictures the newest that had arrived then over a policy's links;
``time/seen_ns`` is the time of what the operator itself had seen, which a delayed link makes older.
"""

from collections.abc import Mapping, Sequence

from common.episodes.columns import Rows
from common.episodes.episode_file import PERIOD_NS
from common.episodes.observation import action, observation, times, truth
from common.schemas import GaitRequest, Header, Setpoint, TaskStatus, TaskVerdict
from common.topics import PLANT_STATE, TASK_STATUS, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE
from lab.demonstrations.collect.pictures import PictureInput, moment_number
from lab.trials.stack import TaskStack
from services.sim.model.world import scene_names


class EpisodeRecorder:
    """Collects the frames of one trial.

    There is no frame before the robot's first measurements and the first pictures have arrived.

    Attributes:
        rows: the frames so far.
        names: names of the columns that depend on the scene, by path.
        moments: number of the moment that each frame's pictures show.
        verdict_frame: first frame after the judge's verdict; -1: there is none yet.
    """

    def __init__(self, stack: TaskStack, pictures: PictureInput) -> None:
        """Subscribe to the messages of a trial that has not begun.

        Args:
            stack: the trial.
            pictures: takes in its pictures.
        """
        self.rows = Rows()
        self.moments: list[int] = []
        self.verdict_frame = -1
        self._plant = plant = stack.plant.plant
        self._pictures = pictures
        self.names: Mapping[str, Sequence[str]] = {
            "truth/scene_qpos": scene_names(plant.model, plant.addresses)
        }
        self._setpoints: list[Header] = []
        self._gaits: list[GaitRequest] = []
        """Requests whose set-point has not come yet."""
        runner = stack.runner
        self._state = runner.newest(PLANT_STATE)
        self._controller = runner.newest(WBC_STATE)
        runner.on_message(TELEOP_SETPOINT, self._on_setpoint)
        runner.on_message(TELEOP_GAIT, self._on_gait)
        runner.on_message(TASK_STATUS, self._on_task_status)

    def _on_task_status(self, status: TaskStatus) -> None:
        if status.verdict is not TaskVerdict.RUNNING and self.verdict_frame < 0:
            self.verdict_frame = len(self.rows)

    def _on_setpoint(self, setpoint: Setpoint) -> None:
        state, controller, picture = self._state(), self._controller(), self._pictures.newest
        if state is None or controller is None or picture is None:
            return
        plant = self._plant
        truth_state = plant.truth()
        frame = times(
            plant.now_ns,
            state=state.header.stamp,
            controller=controller.header.stamp,
            picture=picture.header.stamp,
            truth=truth_state.header.stamp,
            seen=setpoint.header.stamp,
        )
        frame |= observation(state, controller) | action(setpoint)
        frame |= truth(truth_state, plant.view.state(plant.now_ns, plant.reset_count))
        for path, value in frame.items():
            self.rows.rows[path].append(value)
        self.moments.append(moment_number(picture))
        self._setpoints.append(setpoint.header)
        for request in [r for r in self._gaits if _same_sample(r.header, setpoint.header)]:
            self._gaits.remove(request)
            self._ask_for(request, len(self._setpoints) - 1)

    def _on_gait(self, request: GaitRequest) -> None:
        """Put a request into the frame of its set-point, which may come before or after it."""
        for frame, setpoint in enumerate(self._setpoints):
            if _same_sample(request.header, setpoint):
                self._ask_for(request, frame)
                return
        self._gaits.append(request)

    def _ask_for(self, request: GaitRequest, frame: int) -> None:
        self.rows.rows["action/locomotion"][frame] = int(request.gait)


def _same_sample(one: Header, other: Header) -> bool:
    """Return whether the operator gave two messages together.

    They then carry the time of what it saw. While it sees nothing new its later messages carry the
    same, but were captured a period later.
    """
    return one.stamp == other.stamp and 2 * abs(one.captured - other.captured) < PERIOD_NS
