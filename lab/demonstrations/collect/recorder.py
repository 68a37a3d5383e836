"""Records the frames of a trial, twenty times a second.

Each set-point of the operator makes one frame. Its observation is the newest that the robot had at
that moment; ``time/seen_ns`` is the time of what the operator itself had seen, which a delayed link
makes older.
"""

from collections.abc import Mapping, Sequence

from common.episodes.columns import Rows
from common.episodes.observation import action, observation, times, truth
from common.schemas import (
    GaitRequest,
    PlantState,
    SceneState,
    Setpoint,
    TaskStatus,
    TaskVerdict,
)
from common.topics import PLANT_STATE, TASK_STATUS, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE
from lab.trials.stack import TaskStack
from services.sim.model.world import scene_names


class EpisodeRecorder:
    """Collects the frames of one trial.

    Attributes:
        rows: the frames so far.
        names: names of the columns that depend on the scene, by path.
        scenes: states of robot and scene in each frame, to be rendered.
        verdict_frame: first frame after the judge's verdict; -1: there is none yet.
    """

    def __init__(self, stack: TaskStack) -> None:
        """Subscribe to the messages of a trial that has not begun."""
        self.rows = Rows()
        self.scenes: list[tuple[PlantState, SceneState]] = []
        self.verdict_frame = -1
        self._plant = plant = stack.plant.plant
        self.names: Mapping[str, Sequence[str]] = {
            "truth/scene_qpos": scene_names(plant.model, plant.addresses)
        }
        self._gait: GaitRequest | None = None
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
        state, controller = self._state(), self._controller()
        if state is None or controller is None:
            return
        truth_state = self._plant.truth()
        scene = self._plant.view.state(self._plant.now_ns, self._plant.reset_count)
        self.scenes.append((truth_state, scene))
        frame = times(
            self._plant.now_ns,
            state=state.header.stamp,
            controller=controller.header.stamp,
            # The pictures are rendered from the truth.
            picture=truth_state.header.stamp,
            truth=truth_state.header.stamp,
            seen=setpoint.header.stamp,
        )
        frame |= observation(state, controller) | action(setpoint) | truth(truth_state, scene)
        if self._gait is not None:
            frame["action/locomotion"], self._gait = int(self._gait.gait), None
        for path, value in frame.items():
            self.rows.rows[path].append(value)

    def _on_gait(self, request: GaitRequest) -> None:
        """Put a request into the frame of its sample's set-point, which may come before or after.

        Both carry the time of what the operator saw.
        """
        gaits, seen = self.rows.rows["action/locomotion"], self.rows.rows["time/seen_ns"]
        if seen and seen[-1] == request.header.stamp:
            gaits[-1] = int(request.gait)
        else:
            self._gait = request
