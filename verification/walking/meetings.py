"""Hands sent where they meet each other or the body: does the robot stand, and how hard it presses.

The targets are what an operator's slip or a lost controller makes of set-points: both hands to one
point, crossed, into the chest, behind the body, one high and one low; with the hands rolled and
tilted, gliding there or set there at once, interpolated or raw.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from common.robot.frames import COLLISION_SUFFIX
from common.robot.rotations import multiply, quaternion_from_rotation_vector
from common.robot.workspace import X_RANGE, Y_RANGE, Z_RANGE
from common.schemas.arrays import Float64Array as Array
from verification.walking.measures import BALANCE_TIME, REACH, Numbers
from verification.walking.stack import FORWARD, Scenario, Stack

KINDS = ("middle", "crossed", "chest", "behind", "high and low")
GLIDE = 0.75
"""Time of a glide to the targets [s]; a jump takes none."""
HELD = 3.0
"""Time for which the targets are held [s]."""
PRESSED = 10.0
"""Force between two parts of the robot from which they count as pressed [N]."""


@dataclass(frozen=True)
class Meeting:
    """Targets of both hands in the body frame, and the way there.

    Attributes:
        kind: one of :data:`KINDS`.
        left, right: positions (3,) [m].
        quaternions: (left, right) orientations (w, x, y, z).
        mode: how the controller follows the set-points.
        glide: time of the set-points' way from :data:`~verification.walking.measures.REACH` [s].
        seed: of the noise on the state.
    """

    kind: str
    left: Array
    right: Array
    quaternions: tuple[Array, Array] = (FORWARD, FORWARD)
    mode: Literal["interpolate", "raw"] = "interpolate"
    glide: float = GLIDE
    seed: int = 0

    def motion(self, time: float) -> tuple[Array, Array]:
        """Return the set-points' positions (left, right) at a time [s]."""
        elapsed = time - BALANCE_TIME
        share = min(1.0, max(0.0, elapsed / self.glide)) if self.glide else float(elapsed >= 0.0)
        left, right = REACH
        return left + share * (self.left - left), right + share * (self.right - right)

    def scenario(self, base: Scenario) -> Scenario:
        """Return a scenario under this meeting."""
        return replace(
            base,
            hands=self.motion,
            hand_quaternions=self.quaternions,
            hand_mode=self.mode,
            seed=self.seed,
        )

    def __str__(self) -> str:
        """Return what is needed to see a fall again."""
        return f"{self.kind} #{self.seed}"


def random_meetings(count: int, seed: int) -> tuple[Meeting, ...]:
    """Return seeded meetings, the kinds in turn; half glide, and three of four are interpolated.

    The hands point ahead, each rolled by up to 90° and turned by up to 30°.
    """
    rng = np.random.default_rng(seed)
    return tuple(_random_meeting(rng, index) for index in range(count))


def _random_meeting(rng: np.random.Generator, index: int) -> Meeting:
    kind = KINDS[index % len(KINDS)]
    left, right = _targets(rng, kind)
    rolls = rng.uniform(-0.5 * np.pi, 0.5 * np.pi, 2)
    turns = rng.uniform(-1.0, 1.0, (2, 3)) * np.radians(30.0)
    quaternions = [
        multiply(
            quaternion_from_rotation_vector(turn),
            multiply(quaternion_from_rotation_vector(np.array((roll, 0.0, 0.0))), FORWARD),
        )
        for roll, turn in zip(rolls, turns, strict=True)
    ]
    mode: Literal["interpolate", "raw"] = "raw" if rng.random() < 0.25 else "interpolate"
    glide = GLIDE if rng.random() < 0.5 else 0.0
    return Meeting(kind, left, right, (quaternions[0], quaternions[1]), mode, glide, index)


def _targets(rng: np.random.Generator, kind: str) -> tuple[Array, Array]:
    """Return targets (left, right) of a kind; the controller clamps them to the workspace."""
    near, middle = X_RANGE[0], -Y_RANGE[0]
    corners = np.array((X_RANGE, (-middle, middle), Z_RANGE)).T
    left, right = rng.uniform(*corners), rng.uniform(*corners)
    if kind == "middle":
        right = left
    elif kind == "crossed":
        left[1], right[1] = -rng.uniform(0.0, middle), rng.uniform(0.0, middle)
    elif kind == "chest":
        left[0], right[0] = rng.uniform(-0.1, near + 0.05, 2)
    elif kind == "behind":
        left[0], right[0] = rng.uniform(-0.4, 0.0, 2)
        left[1], right[1] = rng.uniform(-0.2, 0.2, 2)
    else:
        left[2], right[2] = rng.permutation(Z_RANGE)
        right[:2] = left[:2]
    return left, right


def meet(meeting: Meeting, base: Scenario) -> tuple[bool, dict[tuple[str, str], float]]:
    """Run one meeting; return whether the robot fell, and the greatest forces between its parts."""
    stack = Stack(meeting.scenario(base))
    stack.run_for(BALANCE_TIME)
    greatest: defaultdict[tuple[str, str], float] = defaultdict(float)
    end = stack.time + meeting.glide + HELD
    while stack.time < end and not stack.fallen:
        stack.run_for(0.02)
        for first, second, force in stack.plant.contacts():
            if first.endswith(COLLISION_SUFFIX) and second.endswith(COLLISION_SUFFIX):
                greatest[first, second] = max(greatest[first, second], force)
    return stack.fallen, dict(greatest)


def meetings(runs: Sequence[Meeting], base: Scenario) -> Numbers:
    """Run meetings one after the other; count the falls and the pressed parts."""
    fallen, pressed, greatest = [], 0, 0.0
    for meeting in runs:
        fell, forces = meet(meeting, base)
        if fell:
            fallen.append(str(meeting))
        worst = max(forces.values(), default=0.0)
        pressed += worst > PRESSED
        greatest = max(greatest, worst)
    return {
        "meetings": len(runs),
        "falls": len(fallen),
        "fell_at": ", ".join(fallen),
        "pressed": pressed,
        "force_n": greatest,
    }
