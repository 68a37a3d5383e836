"""Schema of operator scripts: a list of steps, in Python or as a JSON file.

Steps run one after another; ``Together`` runs several lists side by side. Hand poses are in the
body frame (``torso_link``), for instance::

    {"name": "wave", "steps": [
      {"do": "move", "left": {"position": [0.35, 0.22, 0.1]}, "duration": 2.0},
      {"do": "together", "lanes": [
        [{"do": "gait", "gait": "forward", "count": 2}],
        [{"do": "sine", "hand": "left", "axis": "z", "amplitude": 0.05, "duration": 4.0}]]},
      {"do": "grip", "left": 1.0},
      {"do": "mark", "label": "done"}]}
"""

from math import pi
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from common.errors import ConfigError, explain
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.teleop.targets.hand import MotionLimits, hand_quaternion

Side = Literal["left", "right"]
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]


def _gait(value: object) -> object:
    if isinstance(value, str):
        try:
            return Gait[value.upper()]
        except KeyError as error:
            raise ValueError(f"expected one of {', '.join(GAIT_NAMES)}, got {value!r}") from error
    return value


GAIT_NAMES = tuple(gait.name.lower() for gait in Gait if gait is not Gait.NONE)
GaitName = Annotated[Gait, BeforeValidator(_gait)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class HandPose(_Part):
    """Pose of a hand in the body frame.

    ``rotation`` is (roll, pitch, yaw) [rad] about the body's x, y, z from a hand that points
    straight ahead: positive pitch points it down, positive yaw to the left. None keeps the present
    rotation.
    """

    position: tuple[float, float, float] = Field(description="[m]")
    rotation: tuple[float, float, float] | None = Field(
        default=(0.0, 0.0, 0.0),
        description="roll, pitch, yaw [rad]; null: keeps the orientation it has",
    )

    def quaternion(self) -> Array | None:
        """Return the rotation (4,), or None to keep the present one."""
        return None if self.rotation is None else hand_quaternion(*self.rotation)

    def mirrored(self) -> "HandPose":
        """Return the mirror image for the other hand."""
        x, y, z = self.position
        if self.rotation is None:
            return HandPose(position=(x, -y, z), rotation=None)
        roll, pitch, yaw = self.rotation
        return HandPose(position=(x, -y, z), rotation=(-roll, pitch, -yaw))


class Wait(_Part):
    """Do nothing for a while."""

    do: Literal["wait"] = "wait"
    seconds: Seconds = Field(description="how long [s]")


class Move(_Part):
    """Move one or both hands to poses along minimum-jerk paths within the speed limits."""

    do: Literal["move"] = "move"
    left: HandPose | None = Field(default=None, description="goal of the left hand")
    right: HandPose | None = Field(default=None, description="goal of the right hand")
    duration: Seconds = Field(default=2.0, description="shortest duration [s]")

    @model_validator(mode="after")
    def _moves_something(self) -> "Move":
        if self.left is None and self.right is None:
            raise ValueError("expected a pose for the left or the right hand, got none")
        return self


class Sine(_Part):
    """Swing one hand about its position; the swing fades in and out in a quarter of the time."""

    do: Literal["sine"] = "sine"
    hand: Side = Field(description="which hand swings")
    axis: Literal["x", "y", "z"] = Field(description="of the body frame")
    amplitude: float = Field(gt=0.0, le=0.2, description="[m]")
    frequency: float = Field(default=0.5, gt=0.0, le=2.0, description="[Hz]")
    duration: Seconds = Field(default=4.0, description="[s]")

    @model_validator(mode="after")
    def _within_speed(self) -> "Sine":
        peak, limit = 2 * pi * self.frequency * self.amplitude, MotionLimits().linear_speed
        if peak > limit:
            raise ValueError(
                f"expected a peak speed (2 pi frequency amplitude) of at most {limit} m/s, "
                f"got {peak:.3f}; lower the amplitude or the frequency"
            )
        return self


class Grip(_Part):
    """Open (0) or close (1) grippers, and wait until their targets are there."""

    do: Literal["grip"] = "grip"
    left: float | None = Field(default=None, ge=0.0, le=1.0, description="closure; null: as it is")
    right: float | None = Field(default=None, ge=0.0, le=1.0, description="likewise")


class Neck(_Part):
    """Pitch the head, positive looks down, and wait until its target is there."""

    do: Literal["neck"] = "neck"
    pitch: float = Field(ge=-0.523599, le=1.309, description="[rad]")


class Walk(_Part):
    """Request a gait and wait until it is completed, ``count`` times."""

    do: Literal["gait"] = "gait"
    gait: GaitName = Field(description="its name, in lower or upper case; not none")
    count: int = Field(default=1, ge=1, le=1000, description="times in a row")

    @model_validator(mode="after")
    def _goes_somewhere(self) -> "Walk":
        if self.gait is Gait.NONE:
            raise ValueError(f"expected one of {', '.join(GAIT_NAMES)}, got none")
        return self


class Mark(_Part):
    """Set the label in the operator's status and in its log."""

    do: Literal["mark"] = "mark"
    label: str = Field(max_length=200, description="shown in the status and the log")


class Together(_Part):
    """Run several lists of steps side by side, until the last has ended.

    No two lanes may use the same hand, gripper, the neck or the legs.
    """

    do: Literal["together"] = "together"
    lanes: tuple[tuple["Step", ...], ...] = Field(description="lists of steps")

    @model_validator(mode="after")
    def _lanes_disjoint(self) -> "Together":
        seen: set[str] = set()
        for lane in self.lanes:
            used = {part for step in lane for part in parts_used(step)}
            if clash := seen & used:
                raise ValueError(f"two lanes use the same {', '.join(sorted(clash))}")
            seen |= used
        return self


Step = Annotated[
    Wait | Move | Sine | Grip | Neck | Walk | Mark | Together, Field(discriminator="do")
]
Together.model_rebuild()


def parts_used(step: Step) -> set[str]:
    """Return the parts of the robot that a step moves."""
    match step:
        case Move() | Grip():
            kind = "hand" if isinstance(step, Move) else "gripper"
            used = {"left": step.left, "right": step.right}
            return {f"{side} {kind}" for side, value in used.items() if value is not None}
        case Sine():
            return {f"{step.hand} hand"}
        case Neck():
            return {"neck"}
        case Walk():
            return {"legs"}
        case Together():
            return {part for lane in step.lanes for s in lane for part in parts_used(s)}
        case _:
            return set()


class Script(_Part):
    """A named list of steps."""

    name: str = Field(max_length=64, description="shown in the status")
    steps: tuple[Step, ...] = Field(description="played one after the other")


def load_script(path: Path) -> Script:
    """Read a script from a JSON file.

    Raises:
        ConfigError: the file cannot be read or is not a script.
    """
    try:
        return Script.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"cannot read the script {path}: {error.strerror}") from error
    except ValidationError as error:
        raise ConfigError(f"the script {path} is wrong: {explain(error)}") from error


def axis_vector(axis: Literal["x", "y", "z"]) -> Array:
    """Return the unit vector (3,) of a body axis."""
    vector = np.zeros(3)
    vector["xyz".index(axis)] = 1.0
    return vector
