"""How far and how straight the robot walked, judged from ground truth. Pure.

Planar poses are (x [m], y [m], yaw [rad]). The reference point is the ground point between the
feet of the nominal crouch, which lies ahead of the torso's origin: so a turn on the spot reads as
no distance.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, degrees, hypot, sin
from typing import Final

from common.robot.pose import Pose2
from common.robot.rotations import yaw_from_quaternion
from common.schemas import Gait, GaitOutcome, GaitReply, GaitRequest, PlantState
from lab.review.run_summary import GaitRun, Walk
from services.wbc.config import GaitConfig

FEET_AHEAD_OF_TORSO: Final = 0.0537
"""x of the point between the feet in the torso frame, nominal crouch [m]."""


def commanded_motions(config: GaitConfig) -> dict[Gait, Pose2]:
    """What one gait of each type should do under the controller's ``config``."""
    return {
        Gait.FORWARD: Pose2(x=config.forward_step),
        Gait.BACKWARD: Pose2(x=-config.backward_step),
        Gait.SIDE_LEFT: Pose2(y=config.side_step),
        Gait.SIDE_RIGHT: Pose2(y=-config.side_step),
        Gait.TURN_LEFT: Pose2(yaw=config.turn_angle),
        Gait.TURN_RIGHT: Pose2(yaw=-config.turn_angle),
    }


def planar_pose(truth: PlantState) -> Pose2:
    """Pose on the floor of the point between the (nominal) feet, heading from the torso's yaw."""
    yaw = yaw_from_quaternion(truth.base_quaternion)
    return Pose2(
        float(truth.base_position[0]) + FEET_AHEAD_OF_TORSO * cos(yaw),
        float(truth.base_position[1]) + FEET_AHEAD_OF_TORSO * sin(yaw),
        yaw,
    )


class Track:
    """Where the robot is: fed with ground truth in the order it arrived."""

    def __init__(self) -> None:
        self.last: Pose2 | None = None
        self.stamp = 0

    def add(self, truth: PlantState) -> None:
        """Take in the newest ground truth."""
        self.last, self.stamp = planar_pose(truth), truth.header.stamp


_UNHEARD = ("", 0)
"""Sender of a request that was answered but not (or not yet) recorded."""


@dataclass
class _Request:
    request_id: int
    sender: tuple[str, int]
    gait: Gait
    outcome: str = "requested"
    reason: str = ""
    refusals: int = 0
    started: tuple[int, Pose2] | None = None
    ended: tuple[int, Pose2] | None = None

    def moved(self) -> Pose2:
        """The motion from its acceptance to its end; none if either is not known."""
        return self.started[1].to(self.ended[1]) if self.started and self.ended else Pose2()


class GaitLedger:
    """Matches gait requests with their replies and with the motion in between.

    A sender's request is known by its id, however often it is sent; replies name the id alone and
    answer the latest request with it. A reply whose request was not recorded counts too.
    """

    def __init__(self) -> None:
        self._requests: list[_Request] = []
        self._latest: dict[int, _Request] = {}

    def request(self, message: GaitRequest) -> None:
        """Note a request."""
        sender = (message.header.source, message.header.boot)
        known = self._latest.get(message.request_id)
        if known is not None and known.sender == _UNHEARD:
            known.sender = sender  # two links: the answer may overtake its request
        elif known is None or known.sender != sender:
            self._open(message.request_id, message.gait, sender)

    def reply(self, message: GaitReply, track: Track) -> None:
        """Note a reply; the robot is where ``track`` last saw it.

        A request that is sent again is answered again. What was said of it before stands: a gait
        began with its first acceptance, and what is over stays so.
        """
        entry = self._latest.get(message.request_id) or self._open(
            message.request_id, message.gait, _UNHEARD
        )
        if not _is_news(entry.outcome, message.outcome):
            return
        here = None if track.last is None else (track.stamp, track.last)
        if message.outcome is GaitOutcome.ACCEPTED:
            entry.started = here
        elif message.outcome is GaitOutcome.REFUSED:
            entry.refusals += 1
        else:
            entry.ended = here
        entry.outcome = message.outcome.name.lower()
        entry.reason = message.reason or entry.reason

    def runs(self, commanded: Mapping[Gait, Pose2]) -> list[GaitRun]:
        """All requests in the order they were made."""
        return [_run(entry, commanded.get(entry.gait, Pose2())) for entry in self._requests]

    def walk(self, commanded: Mapping[Gait, Pose2]) -> Walk:
        """All completed gaits together: where they led, and where they should have led."""
        done = [one for one in self._requests if one.outcome == "completed"]
        goal, turned, turned_wanted, distance, distance_wanted = Pose2(), 0.0, 0.0, 0.0, 0.0
        for one in done:
            moved, step = one.moved(), commanded.get(one.gait, Pose2())
            goal = goal.then(step)
            turned, turned_wanted = turned + moved.yaw, turned_wanted + step.yaw
            if step.x or step.y:
                distance += hypot(moved.x, moved.y)
                distance_wanted += hypot(step.x, step.y)
        reached = Pose2()
        if done and done[0].started and done[-1].ended:
            reached = done[0].started[1].to(done[-1].ended[1])
        return Walk(
            distance=distance,
            commanded_distance=distance_wanted,
            forward=reached.x,
            left=reached.y,
            turn_deg=degrees(turned),
            commanded_forward=goal.x,
            commanded_left=goal.y,
            commanded_turn_deg=degrees(turned_wanted),
            end_error=hypot(reached.x - goal.x, reached.y - goal.y),
        )

    def _open(self, request_id: int, gait: Gait, sender: tuple[str, int]) -> _Request:
        entry = _Request(request_id, sender, gait)
        self._requests.append(entry)
        self._latest[request_id] = entry
        return entry


def _is_news(known: str, said: GaitOutcome) -> bool:
    """Whether an answer tells of a request what was not known."""
    if said is GaitOutcome.REFUSED:
        return known == "requested"
    if said is GaitOutcome.ACCEPTED:
        return known in {"requested", "refused"}
    return known not in {"completed", "aborted"}


def _run(entry: _Request, wanted: Pose2) -> GaitRun:
    duration, moved = 0.0, entry.moved()
    if entry.started and entry.ended:
        duration = (entry.ended[0] - entry.started[0]) * 1e-9
    return GaitRun(
        request_id=entry.request_id,
        gait=entry.gait.name.lower(),
        outcome=entry.outcome,
        reason=entry.reason,
        refusals=entry.refusals,
        duration=duration,
        forward=moved.x,
        left=moved.y,
        turn_deg=degrees(moved.yaw),
        commanded_forward=wanted.x,
        commanded_left=wanted.y,
        commanded_turn_deg=degrees(wanted.yaw),
    )
