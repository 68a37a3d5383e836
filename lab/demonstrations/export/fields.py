"""THE table of exported numbers: which columns make up state and action, and their names.

Numbers are the episode's own as float32, neither scaled nor rotated nor differenced. Quaternions
stay (w, x, y, z), and poses stay in the body frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.episodes.columns import AXES, BY_PATH, COLUMNS
from common.episodes.episode_file import Episode
from common.errors import ConfigError
from common.robot.frames import BODY_FRAME
from lab.demonstrations.export.gaits import GAIT_NAMES, Float32, held_gaits, one_hot

ROBOT = "draco3"


@dataclass(frozen=True)
class ColumnRange:
    """Successive columns of an episode's array.

    Attributes:
        key: name of the range, as ``left_hand``.
        path: path of the array.
        names: names of the columns in the export.
        first: index of the first column in the array.
    """

    key: str
    path: str
    names: tuple[str, ...]
    first: int = 0

    @property
    def doc(self) -> str:
        """What the numbers mean, with unit and frame."""
        column = BY_PATH[self.path]
        frame = AXES if column.frame == BODY_FRAME else column.frame
        details = [detail for detail in (column.unit, frame and f"in {frame}") if detail]
        return column.doc + (f" [{'; '.join(details)}]" if details else "")

    def read(self, episode: Episode, frames: slice) -> Float32:
        """Read the numbers (frames, columns) of an episode."""
        values = episode.array(self.path, frames)
        table = values.reshape(len(values), -1)[:, self.first : self.first + len(self.names)]
        return np.asarray(table, dtype=np.float32)


@dataclass(frozen=True)
class GaitRange(ColumnRange):
    """The gait, as it was asked for or in another form.

    Attributes:
        held: whether a gait stays in all frames until it has been walked.
        one_hot: whether there is a column for each gait, instead of one with its number.
    """

    held: bool = False
    one_hot: bool = False

    @property
    def doc(self) -> str:
        """What the numbers mean."""
        if not self.held and not self.one_hot:
            return super().doc
        number = "1 in the column of the" if self.one_hot else "number of the"
        until = "gait, until it has been walked" if self.held else "gait asked for in this frame"
        return f"{number} {until} ({', '.join(f'{i} {n}' for i, n in enumerate(GAIT_NAMES))})"

    def read(self, episode: Episode, frames: slice) -> Float32:
        """Read the numbers (frames, columns) of an episode."""
        gaits = episode.array(self.path, slice(0, frames.stop))
        if self.held:
            states = episode.array("observation/control_state", slice(0, frames.stop))
            gaits = held_gaits(gaits, states)
        gaits = gaits[frames]
        return one_hot(gaits) if self.one_hot else gaits.astype(np.float32)[:, None]


def _all_columns(key: str, path: str, prefix: str = "", suffix: str = "") -> ColumnRange:
    """Return all columns of an array; an array without columns is named by its path's last part."""
    names = BY_PATH[path].names or (path.rpartition("/")[2],)
    return ColumnRange(key, path, tuple(f"{prefix}{name}{suffix}" for name in names))


def _columns_of(key: str, path: str, prefix: str) -> ColumnRange:
    """Return the columns whose names begin with ``prefix``."""
    names = BY_PATH[path].names
    chosen = tuple(name for name in names if name.startswith(prefix))
    return ColumnRange(key, path, chosen, names.index(chosen[0]))


def _poses(path: str, *things: str) -> tuple[ColumnRange, ...]:
    return tuple(_columns_of(thing, path, f"{thing}.") for thing in things)


_JOINTS = "observation/joint_sin_cos"
STATE_PARTS: dict[str, tuple[ColumnRange, ...]] = {
    "feet": _poses("observation/poses", "left_foot", "right_foot"),
    "hands": _poses("observation/poses", "left_hand", "right_hand"),
    "grippers": (_all_columns("grippers", "observation/gripper_closure", suffix="_gripper"),),
    "joints": tuple(_columns_of(f"joints_{f}", _JOINTS, f"{f}.") for f in ("sin", "cos")),
    "velocities": (
        _all_columns("joint_velocity", "observation/joint_velocity", prefix="velocity."),
    ),
    "controller": (_all_columns("controller", "observation/control_state"),),
}
"""The robot's measurements by the names of ``--state``, in the order of the export."""

GAIT_FORMS = ("request", "held", "one-hot", "held-one-hot")
"""Forms of the gait in the actions: as asked for, until walked, or a column for each gait."""

AGES = tuple(
    _all_columns(column.path.removeprefix("age/"), column.path)
    for column in COLUMNS
    if column.path.startswith("age/")
)
"""Age of each observation in its frame, and of what the operator acted on."""


@dataclass(frozen=True)
class ExportColumns:
    """Chooses the numbers of an export.

    Attributes:
        parts: names of :data:`STATE_PARTS` that are exported.
        gait: one of :data:`GAIT_FORMS`.
    """

    parts: tuple[str, ...] = tuple(STATE_PARTS)
    gait: str = GAIT_FORMS[0]

    def __post_init__(self) -> None:
        """Check the names.

        Raises:
            ConfigError: a name is unknown, or there is none.
        """
        unknown = [part for part in self.parts if part not in STATE_PARTS]
        if unknown or not self.parts:
            raise ConfigError(
                f"--state: expected some of {','.join(STATE_PARTS)}, got {','.join(self.parts)!r}"
            )

    @property
    def state(self) -> tuple[ColumnRange, ...]:
        """The robot's measurements, lerobot's ``observation.state``."""
        return tuple(
            columns
            for part, ranges in STATE_PARTS.items()
            if part in self.parts
            for columns in ranges
        )

    @property
    def action(self) -> tuple[ColumnRange, ...]:
        """The operator's set-points."""
        held, many = self.gait.startswith("held"), self.gait.endswith("one-hot")
        names = tuple(f"gait.{name}" for name in GAIT_NAMES) if many else ("locomotion",)
        return (
            *_poses("action/hands", "left_hand", "right_hand"),
            _all_columns("grippers", "action/grasp", suffix="_gripper"),
            GaitRange("locomotion", "action/locomotion", names, held=held, one_hot=many),
            _all_columns("neck", "action/neck"),
        )

    def low_dimensional(self) -> dict[str, ColumnRange]:
        """Return the columns of :attr:`state` by robomimic's customary names.

        Orientations are called ``..._quat_wxyz``: code for robosuite would read x, y, z, w under
        its own ``..._quat``.
        """
        found: dict[str, ColumnRange] = {}
        for columns in self.state:
            if columns.path == "observation/poses":
                name = f"robot0_{columns.key.replace('hand', 'eef')}"
                names = tuple(name.rpartition(".")[2] for name in columns.names)
                found[f"{name}_pos"] = _part(columns, names[:3])
                found[f"{name}_quat_wxyz"] = _part(columns, names[3:], 3)
            elif columns.key == "grippers":
                for index, side in enumerate(BY_PATH[columns.path].names):
                    found[f"robot0_{side}_gripper_qpos"] = _part(columns, ("closure",), index)
            else:
                names = tuple(name.rpartition(".")[2] for name in columns.names)
                found[f"robot0_{_ROBOMIMIC[columns.key]}"] = _part(columns, names)
        return found


_ROBOMIMIC = {
    "joints_sin": "joint_pos_sin",
    "joints_cos": "joint_pos_cos",
    "joint_velocity": "joint_vel",
    "controller": "control_state",
}


def _part(columns: ColumnRange, names: tuple[str, ...], offset: int = 0) -> ColumnRange:
    return ColumnRange(columns.key, columns.path, names, columns.first + offset)


def column_names(ranges: Sequence[ColumnRange]) -> list[str]:
    """Return the names of the columns that :func:`read_columns` returns."""
    return [name for columns in ranges for name in columns.names]


def spans(ranges: Sequence[ColumnRange]) -> dict[str, tuple[int, int]]:
    """Return first and end of each range within the columns of :func:`read_columns`, by key."""
    found, first = {}, 0
    for columns in ranges:
        found[columns.key] = (first, first + len(columns.names))
        first += len(columns.names)
    return found


def read_columns(ranges: Sequence[ColumnRange], episode: Episode, frames: slice) -> Float32:
    """Read ranges side by side (frames, columns)."""
    return np.concatenate([columns.read(episode, frames) for columns in ranges], axis=1)
