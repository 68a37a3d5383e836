"""Compare each gait's motion, taken from ground truth, with its command. Pure.

Planar poses are (x [m], y [m], yaw [rad]) of the point on the floor between the feet of the
nominal crouch. It lies ahead of the torso's origin, so that a turn on the spot covers no distance.
"""

import json
from dataclasses import dataclass
from itertools import groupby
from math import cos, degrees, hypot, sin
from typing import Final, NamedTuple

from common.robot.pose import Pose2
from common.robot.rotations import yaw_from_quaternion
from common.schemas import (
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    PlantState,
    StepJournal,
)
from lab.review.run_summary import GaitRun, Walk
from services.wbc.config import GaitConfig

FEET_AHEAD_OF_TORSO: Final = 0.0537
"""x of the point between the feet in the torso frame, nominal crouch [m]."""


def commanded_motions(config: GaitConfig | None = None) -> dict[Gait, Pose2]:
    """Return the motion that one gait of each type should make; None: by the default config."""
    config = config or GaitConfig()
    return {
        Gait.FORWARD: Pose2(x=config.forward_step),
        Gait.BACKWARD: Pose2(x=-config.backward_step),
        Gait.SIDE_LEFT: Pose2(y=config.side_step),
        Gait.SIDE_RIGHT: Pose2(y=-config.side_step),
        Gait.TURN_LEFT: Pose2(yaw=config.turn_angle),
        Gait.TURN_RIGHT: Pose2(yaw=-config.turn_angle),
    }


def recorded_motions(journal: StepJournal) -> dict[Gait, Pose2] | None:
    """Return :func:`commanded_motions` under the settings that a controller recorded.

    None if ``journal`` is another service's, does not hold the settings (only the first one of a
    service does) or holds settings of another version.
    """
    if journal.service != "wbc" or not journal.settings:
        return None
    try:
        return commanded_motions(GaitConfig.model_validate(json.loads(journal.settings)["gait"]))
    except (KeyError, TypeError, ValueError):
        return None


def planar_pose(truth: PlantState) -> Pose2:
    """Return the pose of the point between the nominal feet, headed as the torso is."""
    yaw = yaw_from_quaternion(truth.base_quaternion)
    return Pose2(
        float(truth.base_position[0]) + FEET_AHEAD_OF_TORSO * cos(yaw),
        float(truth.base_position[1]) + FEET_AHEAD_OF_TORSO * sin(yaw),
        yaw,
    )


class _Place(NamedTuple):
    """Where the robot was: stamp [ns], pose, and the plant's life and reset."""

    stamp: int
    pose: Pose2
    epoch: tuple[int, int]


@dataclass
class _Request:
    request_id: int
    boot: int
    """Boot id of its sender; 0 while it was answered but not, or not yet, recorded."""
    gait: Gait
    outcome: str = "requested"
    reason: str = ""
    refusals: int = 0
    started: _Place | None = None
    """At its acceptance."""
    ended: _Place | None = None

    def motion(self) -> Pose2:
        """Return the motion from its acceptance to its end; zero if either is unknown."""
        return self.started.pose.to(self.ended.pose) if self.started and self.ended else Pose2()


class GaitTracker:
    """Matches gait requests with their replies and with the robot's motion in between.

    A request is identified by the boot id of its sender and its own id, however often it is sent; a
    reply names both. One of an earlier version names the id alone and answers the latest request
    with it. A reply whose request was not recorded counts too. Commanded motions are those of the
    recorded settings of the controller, or of its default configuration where the log has none.
    """

    def __init__(self) -> None:
        self._requests: list[_Request] = []
        self._latest: dict[int, _Request] = {}
        self._known: dict[tuple[int, int], _Request] = {}
        self._here: _Place | None = None
        self._commanded = commanded_motions()

    def journal(self, message: StepJournal) -> None:
        """Take the commanded motions from a journal that has the controller's settings."""
        self._commanded = recorded_motions(message) or self._commanded

    def truth(self, message: PlantState) -> None:
        """Update the robot's pose."""
        epoch = (message.header.boot, message.reset_count)
        self._here = _Place(message.header.stamp, planar_pose(message), epoch)

    def request(self, message: GaitRequest) -> None:
        """Add a request."""
        boot, number = message.header.boot, message.request_id
        latest = self._latest.get(number)
        if latest is not None and not latest.boot:
            latest.boot = boot  # On two links a reply may overtake its request.
            self._known[boot, number] = latest
        elif (boot, number) not in self._known:
            self._open(number, message.gait, boot)

    def reply(self, message: GaitReply) -> None:
        """Add a reply, given while the robot was at its last pose.

        A request that is sent again is answered again, which changes nothing: a gait began with
        its first acceptance and ended with its first completion or abortion.
        """
        boot, number = message.requester_boot, message.request_id
        entry = self._known.get((boot, number)) if boot else self._latest.get(number)
        entry = entry or self._open(number, message.gait, boot)
        if not _is_new(entry.outcome, message.outcome):
            return
        if message.outcome is GaitOutcome.ACCEPTED:
            entry.started = self._here
        elif message.outcome is GaitOutcome.REFUSED:
            entry.refusals += 1
        else:
            entry.ended = self._here
        entry.outcome = message.outcome.name.lower()
        entry.reason = message.reason or entry.reason

    def runs(self) -> list[GaitRun]:
        """Return every request with its outcome, in the order of the requests."""
        return [_run(entry, self._commanded.get(entry.gait, Pose2())) for entry in self._requests]

    def walk(self) -> Walk:
        """Compare where all completed gaits together led with where they should have led."""
        done = [entry for entry in self._requests if entry.outcome == "completed"]
        goal, turned, turned_wanted, distance, distance_wanted = Pose2(), 0.0, 0.0, 0.0, 0.0
        for entry in done:
            motion, step = entry.motion(), self._commanded.get(entry.gait, Pose2())
            goal = goal.then(step)
            turned, turned_wanted = turned + motion.yaw, turned_wanted + step.yaw
            if step.x or step.y:
                distance += hypot(motion.x, motion.y)
                distance_wanted += hypot(step.x, step.y)
        reached = Pose2()
        # A reset or a restart of the plant puts the robot elsewhere, which is no walking.
        walked = [entry for entry in done if entry.started and entry.ended]
        for _, some in groupby(walked, key=lambda entry: entry.started and entry.started.epoch):
            gaits = list(some)
            first, last = gaits[0], gaits[-1]
            if first.started and last.ended:
                reached = reached.then(first.started.pose.to(last.ended.pose))
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

    def _open(self, request_id: int, gait: Gait, boot: int) -> _Request:
        entry = _Request(request_id, boot, gait)
        self._requests.append(entry)
        self._latest[request_id] = entry
        if boot:
            self._known[boot, request_id] = entry
        return entry


def _is_new(known: str, outcome: GaitOutcome) -> bool:
    """Return whether a reply adds to the ``known`` outcome of its request."""
    if outcome is GaitOutcome.REFUSED:
        return known == "requested"
    if outcome is GaitOutcome.ACCEPTED:
        return known in {"requested", "refused"}
    return known not in {"completed", "aborted"}


def _run(entry: _Request, commanded: Pose2) -> GaitRun:
    duration, motion = 0.0, entry.motion()
    if entry.started and entry.ended:
        duration = (entry.ended.stamp - entry.started.stamp) * 1e-9
    return GaitRun(
        request_id=entry.request_id,
        gait=entry.gait.name.lower(),
        outcome=entry.outcome,
        reason=entry.reason,
        refusals=entry.refusals,
        duration=duration,
        forward=motion.x,
        left=motion.y,
        turn_deg=degrees(motion.yaw),
        commanded_forward=commanded.x,
        commanded_left=commanded.y,
        commanded_turn_deg=degrees(commanded.yaw),
    )
