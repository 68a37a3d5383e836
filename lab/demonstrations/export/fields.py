"""THE table of exported numbers: which columns make up state and action, and their names.

Numbers are the episode's own as float32, neither scaled nor rotated nor differenced. Quaternions
stay (w, x, y, z), and poses stay in the body frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.episodes.columns import BY_PATH, COLUMNS
from common.episodes.episode_file import Episode

Float32 = NDArray[np.float32]
ROBOT = "draco3"


@dataclass(frozen=True)
class ColumnRange:
    """Successive columns of an episode's array.

    Attributes:
        path: path of the array.
        names: names of the columns in the export.
        first: index of the first column in the array.
    """

    path: str
    names: tuple[str, ...]
    first: int = 0

    @property
    def doc(self) -> str:
        """What the numbers mean, with unit and frame."""
        column = BY_PATH[self.path]
        details = [detail for detail in (column.unit, column.frame) if detail]
        return column.doc + (f" [{'; in '.join(details)}]" if details else "")

    def read(self, episode: Episode, frames: slice) -> Float32:
        """Read the numbers (frames, columns) of an episode."""
        values = episode.array(self.path, frames)
        table = values.reshape(len(values), -1)[:, self.first : self.first + len(self.names)]
        return np.asarray(table, dtype=np.float32)


def _all_columns(path: str, prefix: str = "", suffix: str = "") -> ColumnRange:
    """Return all columns of an array; an array without columns is named by its path's last part."""
    names = BY_PATH[path].names or (path.rpartition("/")[2],)
    return ColumnRange(path, tuple(f"{prefix}{name}{suffix}" for name in names))


def _columns_of(path: str, prefix: str) -> ColumnRange:
    """Return the columns whose names begin with ``prefix``, named by the rest."""
    names = BY_PATH[path].names
    chosen = [name for name in names if name.startswith(prefix)]
    rest = tuple(name.removeprefix(prefix) for name in chosen)
    return ColumnRange(path, rest, names.index(chosen[0]))


STATE: tuple[ColumnRange, ...] = (
    _all_columns("observation/poses"),
    _all_columns("observation/gripper_closure", suffix="_gripper"),
    _all_columns("observation/joint_sin_cos"),
    _all_columns("observation/joint_velocity", prefix="velocity."),
    _all_columns("observation/control_state"),
)
"""The robot's measurements in this order, lerobot's ``observation.state``."""

ACTION: tuple[ColumnRange, ...] = (
    _all_columns("action/hands"),
    _all_columns("action/grasp", suffix="_gripper"),
    _all_columns("action/locomotion"),
    _all_columns("action/neck"),
)
"""The operator's set-points in this order."""

AGES = tuple(_all_columns(column.path) for column in COLUMNS if column.path.startswith("age/"))
"""Age of each observation in its frame, and of what the operator acted on."""

LIMBS = ("left_foot", "right_foot", "left_hand", "right_hand")


def low_dimensional() -> dict[str, ColumnRange]:
    """Return the columns of :data:`STATE` by robomimic's customary names."""
    poses, grippers, joints = (
        f"observation/{name}" for name in ("poses", "gripper_closure", "joint_sin_cos")
    )
    found: dict[str, ColumnRange] = {}
    for limb in LIMBS:
        pose = _columns_of(poses, f"{limb}.")
        name = limb.replace("hand", "eef")
        found[f"robot0_{name}_pos"] = ColumnRange(poses, pose.names[:3], pose.first)
        found[f"robot0_{name}_quat"] = ColumnRange(poses, pose.names[3:], pose.first + 3)
    for index, side in enumerate(BY_PATH[grippers].names):
        found[f"robot0_{side}_gripper_qpos"] = ColumnRange(grippers, ("closure",), index)
    found["robot0_joint_pos_sin"] = _columns_of(joints, "sin.")
    found["robot0_joint_pos_cos"] = _columns_of(joints, "cos.")
    found["robot0_joint_vel"] = _all_columns("observation/joint_velocity")
    found["robot0_control_state"] = _all_columns("observation/control_state")
    return found


def column_names(ranges: Sequence[ColumnRange]) -> list[str]:
    """Return the names of the columns that :func:`read_columns` returns."""
    return [name for columns in ranges for name in columns.names]


def read_columns(ranges: Sequence[ColumnRange], episode: Episode, frames: slice) -> Float32:
    """Read ranges side by side (frames, columns)."""
    return np.concatenate([columns.read(episode, frames) for columns in ranges], axis=1)
