"""Listens to a trial and lines up what was seen and done, twenty times a second.

A frame belongs to each set-point that the operator gives. Its observation is the newest that the
robot had at that moment; what the operator itself had seen, which a delayed link makes older, is
told by ``time/seen_ns``.
"""

from collections.abc import Callable

import numpy as np

from common.episodes.columns import Rows
from common.robot.kinematics import FORWARD_HAND, end_effector_poses
from common.robot.rotations import nearer_sign
from common.schemas import (
    ControllerState,
    GaitRequest,
    PlantState,
    SceneState,
    Setpoint,
    TaskStatus,
    TaskVerdict,
)
from common.schemas.arrays import Float64Array as Array
from common.topics import PLANT_STATE, TASK_STATUS, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE
from lab.errors import StoppedError
from lab.trials.stack import TaskStack


class EpisodeRecorder:
    """Gathers the frames of one trial.

    Attributes:
        rows: the frames so far.
        scenes: robot and scene of each frame, to be rendered.
        verdict_frame: frame in which the judge had spoken; -1: not yet.
    """

    def __init__(self, stack: TaskStack, stopped: Callable[[], bool]) -> None:
        """Begin to listen.

        Args:
            stack: a trial that has not begun.
            stopped: whether to give up; the trial then ends with :class:`StoppedError`.
        """
        self.rows = Rows()
        self.scenes: list[tuple[PlantState, SceneState]] = []
        self.verdict_frame = -1
        self._plant, self._stopped = stack.plant.plant, stopped
        self._state: PlantState | None = None
        self._controller: ControllerState | None = None
        runner = stack.runner
        runner.on_message(PLANT_STATE, self._measured)
        runner.on_message(WBC_STATE, self._controlled)
        runner.on_message(TELEOP_SETPOINT, self._frame)
        runner.on_message(TELEOP_GAIT, self._gait)
        runner.on_message(TASK_STATUS, self._judged)

    def _measured(self, state: PlantState) -> None:
        self._state = state

    def _controlled(self, state: ControllerState) -> None:
        self._controller = state

    def _judged(self, status: TaskStatus) -> None:
        if status.verdict is not TaskVerdict.RUNNING and self.verdict_frame < 0:
            self.verdict_frame = len(self.rows)

    def _frame(self, setpoint: Setpoint) -> None:
        if self._stopped():
            raise StoppedError("the episode was given up")
        state, controller = self._state, self._controller
        if state is None or controller is None:
            return
        truth = self._plant.truth()
        scene = self._plant.view.state(self._plant.now_ns, self._plant.reset_count)
        self.scenes.append((truth, scene))
        stamps = {
            "state": state.header.stamp,
            "controller": controller.header.stamp,
            "truth": truth.header.stamp,
            "seen": setpoint.header.stamp,
        }
        now = self._plant.now_ns
        row: dict[str, object] = {"time/robot_ns": now}
        row |= {f"time/{name}_ns": stamp for name, stamp in stamps.items()}
        row |= {f"age/{name}": (now - stamp) * 1e-9 for name, stamp in stamps.items()}
        row |= _observation(state, controller) | _action(setpoint) | _truth(truth, scene)
        for path, value in row.items():
            self.rows.rows[path].append(value)

    def _gait(self, request: GaitRequest) -> None:
        # Comes right after the set-point of the same sample.
        gaits = self.rows.rows["action/locomotion"]
        if gaits:
            gaits[-1] = int(request.gait)


def _observation(state: PlantState, controller: ControllerState) -> dict[str, object]:
    q = state.joint_position
    return {
        "observation/poses": end_effector_poses(q),
        "observation/control_state": int(controller.state),
        "observation/joint_sin_cos": np.concatenate((np.sin(q), np.cos(q))),
        "observation/joint_velocity": state.joint_velocity,
        "observation/gripper_closure": state.gripper_closure,
    }


def _action(setpoint: Setpoint) -> dict[str, object]:
    hands: list[Array] = [
        setpoint.left_hand_position_in_body,
        nearer_sign(setpoint.left_hand_quaternion_in_body, FORWARD_HAND),
        setpoint.right_hand_position_in_body,
        nearer_sign(setpoint.right_hand_quaternion_in_body, FORWARD_HAND),
    ]
    return {
        "action/hands": np.concatenate(hands),
        "action/grasp": setpoint.gripper_closure,
        "action/locomotion": 0,
        "action/neck": setpoint.neck_pitch,
    }


def _truth(truth: PlantState, scene: SceneState) -> dict[str, object]:
    return {
        "truth/base_position": truth.base_position,
        "truth/base_quaternion": truth.base_quaternion,
        "truth/joint_position": truth.joint_position,
        "truth/gripper_closure": truth.gripper_closure,
        "truth/scene_qpos": np.array(scene.qpos),
    }
