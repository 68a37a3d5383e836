"""Walking to a place with the six gaits: a short search, or the rule most people would follow."""

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

from common.schemas import Gait
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight

STEPS: dict[Gait, tuple[float, float, float]] = {
    Gait.FORWARD: (0.2, 0.0, 0.0),
    Gait.BACKWARD: (-0.2, 0.0, 0.0),
    Gait.SIDE_LEFT: (0.0, 0.1, 0.0),
    Gait.SIDE_RIGHT: (0.0, -0.1, 0.0),
    Gait.TURN_LEFT: (0.0, 0.0, math.pi / 10),
    Gait.TURN_RIGHT: (0.0, 0.0, -math.pi / 10),
}
"""What the operator has learnt a gait does: forward [m], left [m], turn [rad]."""
_LARGEST_SEARCH = 6000


@dataclass(frozen=True)
class Place:
    """A standing place on the floor: x, y [m] and heading [rad]."""

    x: float
    y: float
    yaw: float

    def after(self, gait: Gait) -> "Place":
        """Where a gait leads."""
        forward, left, turn = STEPS[gait]
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Place(
            self.x + c * forward - s * left,
            self.y + s * forward + c * left,
            math.remainder(self.yaw + turn, math.tau),
        )

    def seen_from(self, other: "Place") -> tuple[float, float, float]:
        """How far ahead and to the left of ``other``, and turned by how much."""
        dx, dy = self.x - other.x, self.y - other.y
        c, s = math.cos(other.yaw), math.sin(other.yaw)
        turn = math.remainder(self.yaw - other.yaw, math.tau)
        return c * dx + s * dy, -s * dx + c * dy, turn


@dataclass(frozen=True)
class Tolerance:
    """Near enough: distance [m] and heading [rad]."""

    distance: float = 0.06
    angle: float = math.radians(8.0)

    def met(self, here: Place, goal: Place) -> bool:
        """Whether ``here`` is near enough to ``goal``."""
        turn = math.remainder(here.yaw - goal.yaw, math.tau)
        near = math.hypot(here.x - goal.x, here.y - goal.y) <= self.distance
        return near and abs(turn) <= self.angle


def place_of(sight: Sight) -> Place:
    """Where the robot is seen to stand."""
    x, y, _ = sight.torso.position.tolist()
    return Place(x, y, sight.torso.yaw)


def plan_gaits(here: Place, goal: Place, tolerance: Tolerance) -> list[Gait]:
    """The fewest gaits that lead near enough to ``goal`` (A*); towards the nearest if none do."""
    queue: list[tuple[float, int, Place, tuple[Gait, ...]]] = [(0.0, 0, here, ())]
    seen: set[tuple[int, int, int]] = set()
    best: tuple[Gait, ...] = ()
    best_off = math.inf
    for _ in range(_LARGEST_SEARCH):
        if not queue:
            break
        _, _, place, gaits = heapq.heappop(queue)
        key = (round(place.x / 0.02), round(place.y / 0.02), round(place.yaw / 0.03))
        if key in seen:
            continue
        seen.add(key)
        if tolerance.met(place, goal):
            return list(gaits)
        off = math.hypot(place.x - goal.x, place.y - goal.y) + 0.3 * abs(
            math.remainder(place.yaw - goal.yaw, math.tau)
        )
        if off < best_off:
            best, best_off = gaits, off
        for gait in STEPS:
            step = place.after(gait)
            left = math.hypot(step.x - goal.x, step.y - goal.y) - tolerance.distance
            turn = abs(math.remainder(step.yaw - goal.yaw, math.tau)) - tolerance.angle
            still = max(0.0, left) / 0.2 + max(0.0, turn) / STEPS[Gait.TURN_LEFT][2]
            heapq.heappush(queue, (len(gaits) + 1 + still, -len(seen), step, (*gaits, gait)))
    return list(best)


def rule_gait(here: Place, goal: Place, tolerance: Tolerance) -> Gait | None:
    """The next gait by a simple rule: straighten up, go ahead, then aside; None: near enough."""
    ahead, left, turn = goal.seen_from(here)
    if abs(turn) > max(tolerance.angle, math.radians(9.5)):
        return Gait.TURN_LEFT if turn > 0 else Gait.TURN_RIGHT
    if abs(ahead) > 0.1:
        return Gait.FORWARD if ahead > 0 else Gait.BACKWARD
    if abs(left) > 0.055:
        return Gait.SIDE_LEFT if left > 0 else Gait.SIDE_RIGHT
    return None


def walk_to(
    person: Person,
    goal: Callable[[Sight], Place],
    tolerance: Tolerance,
    *,
    by_rule: bool = False,
    most: int = 22,
) -> Act:
    """Walk, looking anew after each gait.

    Args:
        person: the operator.
        goal: where to, as seen.
        tolerance: near enough.
        by_rule: straighten up, go ahead, then aside; else plan the whole way.
        most: gaits before giving up.

    Raises:
        StrategyError: not near enough after ``most`` gaits.
    """
    for _ in range(most):
        here, there = place_of(person.sight), goal(person.sight)
        if tolerance.met(here, there):
            return True
        gait = rule_gait(here, there, tolerance) if by_rule else None
        if gait is None:
            gaits = plan_gaits(here, there, tolerance)
            if not gaits:
                return False
            gait = gaits[0]
        person.note = f"{gait.name.lower().replace('_', ' ')}"
        yield from person.gait(gait)
        yield from person.react()
        if person.chance(0.15):
            yield from person.pause(abs(person.vary(0.0, 0.4)))
    raise StrategyError(f"not at the goal after {most} gaits")
