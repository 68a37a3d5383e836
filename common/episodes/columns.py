"""THE table of an episode's arrays: path, width, unit, frame and names.

The file format, the checks and the exports derive from it.

Body frame is ``torso_link`` (x forward, y left, z up). Quaternions are (w, x, y, z), each with the
sign that is nearer to the frame's usual orientation, so that they do not jump.
"""

from dataclasses import dataclass, field

from common.robot.frames import BODY_FRAME
from common.robot.joints import JOINT_NAMES

RATE = 20
"""Frames per second."""
CAMERAS = ("left", "right")
"""The stereo pair."""
SIDES = ("left", "right")
AXES = f"{BODY_FRAME}: x forward, y left, z up"
"""Axes of the body frame, in words."""
_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True)
class Column:
    """Describes one array of an episode, whose first axis counts the frames.

    Attributes:
        path: name of the array in the file.
        unit: unit of its numbers.
        doc: what the numbers mean.
        names: names along the second axis; empty if there is one number a frame.
        frame: coordinate frame of the numbers; empty if they have none.
        dtype: numpy's name of the data type.
        varies: whether the width depends on the scene; ``names`` is empty then, and an episode's
            file has the names.
        optional: whether files of this version may lack it, because it was added later, or because
            not every robot measures it; it is then read as NaN, or as 0 if it is no float.
    """

    path: str
    unit: str
    doc: str
    names: tuple[str, ...] = ()
    frame: str = ""
    dtype: str = "<f8"
    varies: bool = False
    optional: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one frame's numbers; meaningless if the width varies."""
        return (len(self.names),) if self.names else ()


def _poses(*things: str) -> tuple[str, ...]:
    return tuple(f"{thing}.{part}" for thing in things for part in _POSE)


def _joints(prefix: str) -> tuple[str, ...]:
    return tuple(f"{prefix}{name}" for name in JOINT_NAMES)


def _ns(path: str, doc: str, *, optional: bool = False) -> Column:
    return Column(path, "ns", doc, dtype="<i8", optional=optional)


def _truth(path: str, unit: str, doc: str, names: tuple[str, ...], frame: str = "") -> Column:
    return Column(path, unit, doc, names, frame, optional=True)


_METRES = "m; quaternion (w, x, y, z)"

COLUMNS: tuple[Column, ...] = (
    _ns("time/robot_ns", "robot time of the frame: when the action was given"),
    _ns("time/state_ns", "robot time at which the joints were measured"),
    _ns("time/controller_ns", "robot time of the state the controller's state belongs to"),
    _ns("time/picture_ns", "robot time at which the stereo pair was taken", optional=True),
    _ns("time/truth_ns", "robot time of the ground truth", optional=True),
    _ns("time/seen_ns", "robot time of what the operator acted on; older over a delayed link"),
    Column("age/state", "s", "age of the measured joints in this frame"),
    Column("age/controller", "s", "age of the controller's state in this frame"),
    Column("age/picture", "s", "age of the stereo pair in this frame", optional=True),
    Column("age/truth", "s", "age of the ground truth in this frame", optional=True),
    Column("age/seen", "s", "age of what the operator acted on"),
    Column(
        "observation/poses",
        _METRES,
        "feet (sole centres) and hands (between the finger pads), by forward kinematics from the "
        "measured joints",
        _poses("left_foot", "right_foot", "left_hand", "right_hand"),
        BODY_FRAME,
    ),
    Column(
        "observation/control_state",
        "",
        "state machine: 0 stand, 1 balance, 2-4 right foot's contact transition start, its end, "
        "swing, 5-7 left foot's",
        dtype="<i8",
    ),
    Column(
        "observation/joint_sin_cos",
        "1",
        "sine, then cosine, of the measured joint positions",
        _joints("sin.") + _joints("cos."),
    ),
    Column("observation/joint_velocity", "rad/s", "measured joint velocities", JOINT_NAMES),
    Column(
        "observation/gripper_closure", "1", "measured closure of grippers; 0 open, 1 closed", SIDES
    ),
    Column(
        "observation/hand_error",
        "m, m, rad, rad",
        "distance of the hands from their targets, then angle between both, by the controller",
        ("left.position", "right.position", "left.rotation", "right.rotation"),
        optional=True,
    ),
    Column(
        "action/hands",
        _METRES,
        "hand set-points, absolute, within the workspace",
        _poses("left_hand", "right_hand"),
        BODY_FRAME,
    ),
    Column("action/grasp", "1", "gripper set-points; 0 open, 1 closed", SIDES),
    Column(
        "action/locomotion",
        "",
        "gait asked for in this frame: 0 none, 1 forward, 2 backward, 3 side left, 4 side right, "
        "5 turn left, 6 turn right",
        dtype="<i8",
    ),
    Column(
        "action/slip",
        "1",
        "1 while a hand is knocked off its way, which the operator does not mean to do; its way "
        "back is 0, as all else",
        optional=True,
    ),
    Column("action/neck", "rad", "head pitch set-point, positive looks down"),
    Column(
        "intervention",
        "",
        "whether an operator acted in place of the policy that operates the robot in other frames",
        dtype="|b1",
        optional=True,
    ),
    _truth("truth/base_position", "m", "position of torso_link's origin", ("x", "y", "z"), "world"),
    _truth(
        "truth/base_quaternion",
        "1",
        "orientation of torso_link, (w, x, y, z)",
        ("qw", "qx", "qy", "qz"),
        "world",
    ),
    _truth("truth/joint_position", "rad", "exact joint positions", JOINT_NAMES),
    _truth("truth/gripper_closure", "1", "exact closure of grippers; 0 open, 1 closed", SIDES),
    Column(
        "truth/scene_qpos",
        "rad, m",
        "positions of the scene's joints, in model order; free bodies as x, y, z, qw, qx, qy, qz",
        varies=True,
        optional=True,
    ),
)
"""The ``truth`` arrays pose robot and scene at the frame's own time, so that pictures of any size
can be rendered: of that time, while the pictures in the file are as old as ``age/picture`` says. Of
a recorded run they are as old as ``age/truth`` says; a real robot has none."""

BY_PATH = {column.path: column for column in COLUMNS}
"""The same columns by their path."""


@dataclass
class Rows:
    """Collects the frames of an episode: one list of rows for each column."""

    rows: dict[str, list[object]] = field(default_factory=lambda: {c.path: [] for c in COLUMNS})

    def __len__(self) -> int:
        return len(self.rows["time/robot_ns"])
