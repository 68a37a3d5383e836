"""The locomotion state machine: stand up, balance, and one gait at a time on request."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from common.schemas import ControlState, Gait, GaitOutcome
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import WbcConfig
from services.wbc.dcm import natural_frequency
from services.wbc.footsteps import Footprint, Side, Stance, stance_between
from services.wbc.gait_plan import GaitPlan, Phase, plan_gait
from services.wbc.robot_model import Dynamics
from services.wbc.rotations import matrix_from_yaw, wrap_angle, yaw_of
from services.wbc.swing import PoseReference, SwingTrajectory, minimum_jerk

UNLOADED = 1e-3
"""Normal force left to a foot that should carry nothing [N]."""
SWINGS = (ControlState.LF_SWING, ControlState.RF_SWING)


class BodyReference(NamedTuple):
    """What locomotion asks of the body at one instant, in world.

    Attributes:
        com, com_velocity, com_acceleration: (3,).
        dcm: (2,) planned.
        torso: heading reference of torso_link (position unused).
        swing: per foot the reference of its swing, or None for a stance foot.
        normal_force_max: per foot [N]; load: per foot share of the schedule, 0 to 1.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    dcm: Array
    torso: PoseReference
    swing: tuple[PoseReference | None, PoseReference | None]
    normal_force_max: tuple[float, float]
    load: tuple[float, float]


@dataclass(frozen=True)
class Answer:
    """Reply to a gait request."""

    request_id: int
    gait: Gait
    outcome: GaitOutcome
    reason: str = ""


class _FootEstimate:
    """Running mean of a standing foot's pose: the foot does not move, the measurement shakes."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self.reset()

    def reset(self) -> None:
        self._count = 0
        self.position = np.zeros(3)
        self.yaw = 0.0

    def update(self, position: Array, yaw: float) -> None:
        self._count = min(self._count + 1, self._samples)
        gain = 1.0 / self._count
        self.position = self.position + gain * (position - self.position)
        self.yaw = wrap_angle(self.yaw + gain * wrap_angle(yaw - self.yaw))


class Locomotion:
    """Pure state machine; :meth:`update` once a tick with the robot time [s]."""

    def __init__(self, config: WbcConfig) -> None:
        self._config = config
        samples = max(5, round(0.3 * config.rate))
        self._feet = (_FootEstimate(samples), _FootEstimate(samples))
        self._omega = natural_frequency(config.gait.com_height)
        self.state = ControlState.STAND
        self.completed = 0
        self._start_time: float | None = None
        self._start_com = np.zeros(3)
        self._start_yaw = 0.0
        self._anchor: Stance | None = None
        self._plan: GaitPlan | None = None
        self._request: tuple[int, Gait] | None = None
        self._swing: SwingTrajectory | None = None
        self._swing_step = -1
        self._last: BodyReference | None = None
        self._answers: list[Answer] = []
        self._pending: list[tuple[int, Gait]] = []

    @property
    def gait(self) -> Gait:
        """Gait in execution; NONE while standing."""
        return Gait.NONE if self._request is None else self._request[1]

    def request(self, request_id: int, gait: Gait) -> None:
        """Ask for a gait; answered by the next :meth:`update`."""
        self._pending.append((request_id, gait))

    def answers(self) -> list[Answer]:
        """Answers since the last call, oldest first."""
        answers, self._answers = self._answers, []
        return answers

    def progress(self, time: float) -> float:
        """Share of the running gait, 0 while standing."""
        if self._plan is None or self._request is None or self._start_time is None:
            return 0.0
        return min(1.0, max(0.0, (time - self._start_time) / self._plan.duration))

    def update(self, dynamics: Dynamics, time: float) -> BodyReference:
        """Advance to ``time`` and return the references."""
        self._observe_feet(dynamics)
        if self._start_time is None:
            self._begin_stand(dynamics, time)
        self._finish_gait(time)
        self._handle_requests(time)
        if self.state is ControlState.STAND:
            reference = self._standing_up(time)
        elif self._request is not None:
            reference = self._walking(time)
        else:
            reference = self._balancing(time)
        self._last = reference
        return reference

    def _observe_feet(self, dynamics: Dynamics) -> None:
        for side, estimate in enumerate(self._feet):
            if self.state in SWINGS and self._swinging_side() == side:
                estimate.reset()
                continue
            foot = dynamics.feet[side]
            estimate.update(foot.position, yaw_of(foot.rotation))

    def _swinging_side(self) -> Side:
        return 0 if self.state is ControlState.LF_SWING else 1

    def _footprints(self) -> tuple[Footprint, Footprint]:
        left, right = self._feet
        return (
            Footprint(0, left.position[:2].copy(), left.yaw),
            Footprint(1, right.position[:2].copy(), right.yaw),
        )

    def _com_height(self) -> float:
        soles = 0.5 * float(self._feet[0].position[2] + self._feet[1].position[2])
        return soles + self._config.gait.com_height

    def _begin_stand(self, dynamics: Dynamics, time: float) -> None:
        self._start_time = time
        self._start_com = dynamics.com_position.copy()
        self._start_yaw = yaw_of(dynamics.base_rotation)

    def _standing_up(self, time: float) -> BodyReference:
        assert self._start_time is not None
        length = self._config.stand_time
        elapsed = time - self._start_time
        stance = stance_between(*self._footprints())
        goal = np.array([*stance.position, self._com_height()])
        s, sd, sdd = minimum_jerk(elapsed / length, length)
        offset = goal - self._start_com
        if elapsed >= length:
            self.state = ControlState.BALANCE
            self._anchor = stance
        yaw = self._start_yaw + s * wrap_angle(stance.yaw - self._start_yaw)
        com = self._start_com + s * offset
        load = (min(1.0, elapsed / 0.05),) * 2
        return self._reference(
            com, sd * offset, sdd * offset, com[:2], (yaw, 0.0, 0.0), (None, None), load
        )

    def _balancing(self, time: float) -> BodyReference:
        if self._plan is not None and self._start_time is not None:
            return self._along_plan(self._plan, time - self._start_time, (None, None))
        assert self._anchor is not None
        com = np.array([*self._anchor.position, self._com_height()])
        yaw = (self._anchor.yaw, 0.0, 0.0)
        return self._reference(
            com, np.zeros(3), np.zeros(3), com[:2], yaw, (None, None), (1.0, 1.0)
        )

    def _walking(self, time: float) -> BodyReference:
        assert self._plan is not None
        assert self._start_time is not None
        elapsed = time - self._start_time
        phase = self._plan.phase_at(elapsed)
        self.state = phase.state
        swing: list[PoseReference | None] = [None, None]
        if phase.state in SWINGS:
            swing[phase.foot] = self._swing_reference(phase, elapsed)
        return self._along_plan(self._plan, elapsed, (swing[0], swing[1]))

    def _swing_reference(self, phase: Phase, elapsed: float) -> PoseReference:
        assert self._plan is not None
        if self._swing is None or self._swing_step != phase.step:
            foot, other = self._feet[phase.foot], self._feet[1 - phase.foot]
            landing = self._plan.footprints[phase.step]
            self._swing = SwingTrajectory(
                start=foot.position.copy(),
                start_rotation=matrix_from_yaw(foot.yaw),
                end=np.array([*landing.position, float(other.position[2])]),
                end_rotation=matrix_from_yaw(landing.yaw),
                height=self._config.gait.swing_height,
                duration=phase.end - phase.start,
            )
            self._swing_step = phase.step
        return self._swing.at(elapsed - phase.start)

    def _along_plan(
        self,
        plan: GaitPlan,
        elapsed: float,
        swing: tuple[PoseReference | None, PoseReference | None],
    ) -> BodyReference:
        target = plan.dcm.at(elapsed)
        height = self._last_height(swing)
        return self._reference(
            np.array([*target.com, height]),
            np.array([*target.com_velocity, 0.0]),
            np.array([*target.com_acceleration, 0.0]),
            target.dcm,
            plan.yaw_at(elapsed),
            swing,
            (plan.load_at(0, elapsed), plan.load_at(1, elapsed)),
        )

    def _last_height(self, swing: tuple[PoseReference | None, PoseReference | None]) -> float:
        """CoM height above the soles that stand; low-passed, for the ground may step."""
        left, right = (float(foot.position[2]) for foot in self._feet)
        standing = [z for z, s in zip((left, right), swing, strict=True) if s is None]
        goal = sum(standing) / len(standing) + self._config.gait.com_height
        if self._last is None:
            return goal
        last = float(self._last.com[2])
        return last + (goal - last) * min(1.0, 5.0 / self._config.rate)

    def _reference(
        self,
        com: Array,
        velocity: Array,
        acceleration: Array,
        dcm: Array,
        yaw: tuple[float, float, float],
        swing: tuple[PoseReference | None, PoseReference | None],
        load: tuple[float, float],
    ) -> BodyReference:
        up = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        torso = PoseReference(np.zeros(3), matrix_from_yaw(yaw[0]), yaw[1] * up, yaw[2] * up)
        full = self._config.contact.normal_force_max
        limits = (max(UNLOADED, load[0] * full), max(UNLOADED, load[1] * full))
        return BodyReference(com, velocity, acceleration, dcm, torso, swing, limits, load)

    def _finish_gait(self, time: float) -> None:
        if self._request is None or self._plan is None or self._start_time is None:
            return
        if time - self._start_time >= self._plan.duration:
            self._answers.append(Answer(*self._request, GaitOutcome.COMPLETED))
            self._request = None
            self._swing, self._swing_step = None, -1
            self._anchor = self._plan.target
            self.completed += 1
            self.state = ControlState.BALANCE

    def _handle_requests(self, time: float) -> None:
        pending, self._pending = self._pending, []
        for request_id, gait in pending:
            refusal = self._refusal(gait)
            if refusal:
                self._answers.append(Answer(request_id, gait, GaitOutcome.REFUSED, refusal))
                continue
            self._start_gait(request_id, gait, time)
            self._answers.append(Answer(request_id, gait, GaitOutcome.ACCEPTED))

    def _refusal(self, gait: Gait) -> str:
        if gait is Gait.NONE:
            return "NONE is not a gait; ask for one of the six"
        if self._request is not None:
            return f"{self._request[1].name} is still in progress; ask again when it is complete"
        if self.state is not ControlState.BALANCE:
            return f"state is {self.state.name}; gaits start from BALANCE"
        return ""

    def _start_gait(self, request_id: int, gait: Gait, time: float) -> None:
        assert self._last is not None
        footprints = self._footprints()
        last = self._last
        self._plan = plan_gait(
            gait,
            footprints,
            self._anchored(stance_between(*footprints)),
            last.com[:2],
            last.dcm,
            self._config.gait,
        )
        self._request = (request_id, gait)
        self._start_time = time

    def _anchored(self, measured: Stance) -> Stance:
        """Stance to count the next displacement from.

        Counting from where the last gait should have ended keeps landing errors from adding up;
        a robot that was pushed or slipped further than the tolerance starts afresh.
        """
        anchor, config = self._anchor, self._config.gait
        if anchor is None:
            return measured
        off = float(np.linalg.norm(measured.position - anchor.position))
        turned = abs(wrap_angle(measured.yaw - anchor.yaw))
        near = off <= config.anchor_distance and turned <= config.anchor_angle
        return anchor if near else measured
