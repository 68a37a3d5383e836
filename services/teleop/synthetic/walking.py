"""Planning of gaits to a goal: a search, or a simple rule."""

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

from common.robot.pose import Pose2
from common.schemas import Gait
from services.teleop.synthetic.observation import Observation
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError

STEPS: dict[Gait, Pose2] = {
    Gait.FORWARD: Pose2(x=0.2),
    Gait.BACKWARD: Pose2(x=-0.2),
    Gait.SIDE_LEFT: Pose2(y=0.1),
    Gait.SIDE_RIGHT: Pose2(y=-0.1),
    Gait.TURN_LEFT: Pose2(yaw=math.pi / 10),
    Gait.TURN_RIGHT: Pose2(yaw=-math.pi / 10),
}
"""Motion that the operator expects of each gait."""
_LARGEST_SEARCH = 6000


@dataclass(frozen=True)
class Tolerance:
    """How near is near enough: distance [m] and heading [rad]."""

    distance: float = 0.06
    angle: float = math.radians(8.0)

    def met(self, here: Pose2, goal: Pose2) -> bool:
        """Return whether ``here`` is near enough to ``goal``."""
        off = here.to(goal)
        return math.hypot(off.x, off.y) <= self.distance and abs(off.yaw) <= self.angle


def seen_pose(seen: Observation) -> Pose2:
    """Return where the robot is seen to stand."""
    x, y, _ = seen.torso.position.tolist()
    return Pose2(x, y, seen.torso.yaw)


def plan_gaits(here: Pose2, goal: Pose2, tolerance: Tolerance) -> list[Gait]:
    """Return the fewest gaits that lead near enough to the goal (A*), or as near as possible."""
    # The running number decides between equals: poses have no order.
    number = itertools.count()
    queue: list[tuple[float, int, int, Pose2, tuple[Gait, ...]]] = [
        (0.0, 0, next(number), here, ())
    ]
    seen: set[tuple[int, int, int]] = set()
    best: tuple[Gait, ...] = ()
    best_off = math.inf
    for _ in range(_LARGEST_SEARCH):
        if not queue:
            break
        _, _, _, pose, gaits = heapq.heappop(queue)
        key = (round(pose.x / 0.02), round(pose.y / 0.02), round(pose.yaw / 0.03))
        if key in seen:
            continue
        seen.add(key)
        if tolerance.met(pose, goal):
            return list(gaits)
        missing = pose.to(goal)
        off = math.hypot(missing.x, missing.y) + 0.3 * abs(missing.yaw)
        if off < best_off:
            best, best_off = gaits, off
        for gait, motion in STEPS.items():
            step = pose.then(motion)
            left = step.to(goal)
            distance = math.hypot(left.x, left.y) - tolerance.distance
            turn = abs(left.yaw) - tolerance.angle
            still = max(0.0, distance) / 0.2 + max(0.0, turn) / STEPS[Gait.TURN_LEFT].yaw
            cost = len(gaits) + 1 + still
            heapq.heappush(queue, (cost, -len(seen), next(number), step, (*gaits, gait)))
    return list(best)


def rule_gait(here: Pose2, goal: Pose2, tolerance: Tolerance) -> Gait | None:
    """Return the next gait by a rule: turn, walk, then side-step; None if near enough."""
    missing = here.to(goal)
    ahead, left, turn = missing.x, missing.y, missing.yaw
    if abs(turn) > max(tolerance.angle, math.radians(9.5)):
        return Gait.TURN_LEFT if turn > 0 else Gait.TURN_RIGHT
    if abs(ahead) > 0.1:
        return Gait.FORWARD if ahead > 0 else Gait.BACKWARD
    if abs(left) > 0.055:
        return Gait.SIDE_LEFT if left > 0 else Gait.SIDE_RIGHT
    return None


def walk_to(
    operator: OperatorModel,
    goal: Callable[[Observation], Pose2],
    tolerance: Tolerance,
    *,
    by_rule: bool = False,
    most: int = 22,
) -> Act:
    """Walk to a goal, observing it again after each gait.

    Args:
        operator: model of the person.
        goal: function from an observation to the goal.
        tolerance: of the goal.
        by_rule: turn, walk, then side-step; else plan the whole way.
        most: largest number of gaits.

    Raises:
        StrategyError: not near enough after ``most`` gaits.
    """
    for _ in range(most):
        here, there = seen_pose(operator.seen), goal(operator.seen)
        if tolerance.met(here, there):
            return True
        gait = rule_gait(here, there, tolerance) if by_rule else None
        if gait is None:
            gaits = plan_gaits(here, there, tolerance)
            if not gaits:
                return False
            gait = gaits[0]
        operator.note = f"{gait.name.lower().replace('_', ' ')}"
        yield from operator.gait(gait)
        yield from operator.react()
        if operator.chance(0.15):
            yield from operator.pause(abs(operator.vary(0.0, 0.4)))
    raise StrategyError(f"not at the goal after {most} gaits")
