"""THE table of what is exported: which columns make up state and action, and their names.

Numbers are the episode's own as float32: nothing is scaled, turned or differenced. Quaternions stay
(w, x, y, z), poses stay in the body frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.episodes.columns import BY_PATH, COLUMNS
from common.episodes.episode_file import Episode

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Part:
    """Some columns of an episode's array.

    Attributes:
        path: of the array.
        names: one a column, unique in the vector that the part belongs to.
        first: where in the array the columns begin.
    """

    path: str
    names: tuple[str, ...]
    first: int = 0

    @property
    def doc(self) -> str:
        """What it is, with unit and frame."""
        column = BY_PATH[self.path]
        details = [detail for detail in (column.unit, column.frame) if detail]
        return column.doc + (f" [{'; in '.join(details)}]" if details else "")

    def of(self, episode: Episode, frames: slice) -> Float32:
        """The numbers (frames, columns)."""
        values = episode.array(self.path, frames)
        table = values.reshape(len(values), -1)[:, self.first : self.first + len(self.names)]
        return np.asarray(table, dtype=np.float32)


def _whole(path: str, prefix: str = "", suffix: str = "") -> Part:
    """All of an array, by its own names or, if it is one number a frame, the last of its path."""
    names = BY_PATH[path].names or (path.rpartition("/")[2],)
    return Part(path, tuple(f"{prefix}{name}{suffix}" for name in names))


def _some(path: str, start: str) -> Part:
    """The columns of an array whose names begin with ``start``; they are named by what follows."""
    names = BY_PATH[path].names
    chosen = [name for name in names if name.startswith(start)]
    return Part(path, tuple(n.removeprefix(start) for n in chosen), names.index(chosen[0]))


STATE: tuple[Part, ...] = (
    _whole("observation/poses"),
    _whole("observation/gripper_closure", suffix="_gripper"),
    _whole("observation/joint_sin_cos"),
    _whole("observation/joint_velocity", prefix="velocity."),
    _whole("observation/control_state"),
)
"""What the robot measures, in this order: lerobot's ``observation.state``."""

ACTION: tuple[Part, ...] = (
    _whole("action/hands"),
    _whole("action/grasp", suffix="_gripper"),
    _whole("action/locomotion"),
    _whole("action/neck"),
)
"""What the operator set, in this order."""

AGES: tuple[Part, ...] = tuple(_whole(c.path) for c in COLUMNS if c.path.startswith("age/"))
"""How old each observation was in its frame, and what the operator acted on."""

LIMBS = ("left_foot", "right_foot", "left_hand", "right_hand")


def low_dimensional() -> dict[str, Part]:
    """The parts of :data:`STATE` one by one, by the names that robomimic's users know."""
    poses, grippers, joints = (
        f"observation/{name}" for name in ("poses", "gripper_closure", "joint_sin_cos")
    )
    found: dict[str, Part] = {}
    for limb in LIMBS:
        pose = _some(poses, f"{limb}.")
        name = limb.replace("hand", "eef")
        found[f"robot0_{name}_pos"] = Part(poses, pose.names[:3], pose.first)
        found[f"robot0_{name}_quat"] = Part(poses, pose.names[3:], pose.first + 3)
    for index, side in enumerate(BY_PATH[grippers].names):
        found[f"robot0_{side}_gripper_qpos"] = Part(grippers, ("closure",), index)
    found["robot0_joint_pos_sin"] = _some(joints, "sin.")
    found["robot0_joint_pos_cos"] = _some(joints, "cos.")
    found["robot0_joint_vel"] = _whole("observation/joint_velocity")
    found["robot0_control_state"] = _whole("observation/control_state")
    return found


def names_of(parts: Sequence[Part]) -> list[str]:
    """Names of the columns that :func:`join` returns."""
    return [name for part in parts for name in part.names]


def join(parts: Sequence[Part], episode: Episode, frames: slice) -> Float32:
    """The parts side by side (frames, columns)."""
    return np.concatenate([part.of(episode, frames) for part in parts], axis=1)


def described(parts: Sequence[Part]) -> list[tuple[str, str]]:
    """``(columns, what they are)`` for each part, as ``("0-27", "feet and hands ...")``."""
    lines, first = [], 0
    for part in parts:
        last = first + len(part.names) - 1
        lines.append((f"{first}-{last}" if last > first else f"{first}", part.doc))
        first = last + 1
    return lines
