"""Poses robot and scene from an episode's ground truth; this needs MuJoCo."""

from typing import Any

import mujoco
import numpy as np

from common.episodes.oracle import oracle_names, oracle_numbers
from common.robot.frames import CAMERAS
from common.schemas import PlantState, SceneState
from common.schemas.arrays import Float64Array as Array
from lab.errors import TrainingError
from services.sim.model.robot_state import show_state
from services.sim.model.world import build_model, find_addresses
from services.sim.tasks import find_task
from services.sim.tasks.trial import SceneView

TRUTH = (
    "truth/base_position",
    "truth/base_quaternion",
    "truth/joint_position",
    "truth/gripper_closure",
    "truth/scene_qpos",
)
"""Columns that pose robot and scene."""
_ZEROS = np.zeros(27)


class TruthReader:
    """Turns rows of the ``truth`` columns into the messages that plant and cameras exchange.

    Attributes:
        scene: name of the task's scene.
    """

    def __init__(self, task: str) -> None:
        found = find_task(task)
        self.scene = found.scene
        self._model = build_model(found.scene)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        self._addresses = find_addresses(self._model)
        self._view = SceneView(self._model, self._data, self._addresses, found.scene, found)

    def at(
        self, arrays: dict[str, Any], frame: int, *, scene_frame: int | None = None
    ) -> tuple[PlantState, SceneState]:
        """Return robot and scene in a frame.

        Args:
            arrays: the ``truth`` columns of an episode.
            frame: of the robot, and of the scene unless ``scene_frame`` names another.
            scene_frame: frame of which the scene's joints are taken.
        """
        position, quaternion, joints, grippers, _ = (arrays[path][frame] for path in TRUTH)
        qpos = arrays["truth/scene_qpos"][frame if scene_frame is None else scene_frame]
        state = PlantState(
            base_position=position,
            base_quaternion=quaternion,
            base_linear_velocity=_ZEROS[:3],
            base_angular_velocity=_ZEROS[:3],
            joint_position=joints,
            joint_velocity=_ZEROS,
            joint_torque=_ZEROS,
            gripper_closure=grippers,
            foot_normal_force=_ZEROS[:2],
        )
        return state, self.pose(state, qpos)

    def pose(self, state: PlantState, qpos: Array) -> SceneState:
        """Return the scene's objects and joints with the positions ``qpos`` of its joints."""
        scene = SceneState(scene=self.scene, qpos=qpos.tolist())
        show_state(self._model, self._data, self._addresses, state, scene)
        return self._view.state(0, 0)

    def camera(self, side: str) -> tuple[Array, Array]:
        """Return position (3,) and axes (3, 3), in columns, of a camera as last posed, in world.

        x points right in the picture, y up, and the camera looks along -z.
        """
        camera = self._data.camera(CAMERAS[side])
        return camera.xpos.copy(), camera.xmat.reshape(3, 3).copy()

    def numbers(self, names: tuple[str, ...], arrays: dict[str, Any]) -> Array:
        """Return the numbers (T, n) of the scene called ``names`` in each frame of an episode."""
        frames = range(len(arrays[TRUTH[0]]))
        return np.array([oracle_numbers(names, *self.at(arrays, frame)) for frame in frames])

    def names(self, wanted: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Return the scene's numbers that are wanted by name or by object; none: all of them.

        Raises:
            TrainingError: the scene has no such object or number.
        """
        every = oracle_names(self._view.state(0, 0))
        found: list[str] = []
        for name in wanted:
            parts = [n for n in every if name in {n, n.rpartition(".")[0]}]
            if not parts:
                raise TrainingError(
                    f"expected an object or number of the scene {self.scene!r}, got {name!r}; it "
                    f"has {', '.join(every)}"
                )
            found += parts
        return tuple(dict.fromkeys(found)) or every
