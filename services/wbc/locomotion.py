"""Locomotion state machine: take over, balance, and one gait at a time on request."""

from dataclasses import dataclass

import numpy as np

from common.robot.rotations import matrix_from_yaw, wrap_angle, yaw_from_matrix
from common.schemas import ControlState, Gait, GaitOutcome
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import WbcConfig
from services.wbc.dcm import natural_frequency
from services.wbc.footsteps import Footprint, Side, Stance, stance_between
from services.wbc.gait_plan import GaitPlan, Phase, plan_gait
from services.wbc.references import BodyReference, PoseReference, SwingPair, force_limits, heading
from services.wbc.robot_model import Dynamics
from services.wbc.swing import SwingTrajectory
from services.wbc.takeover import Takeover

SWINGS = (ControlState.LF_SWING, ControlState.RF_SWING)


@dataclass(frozen=True)
class Answer:
    """Reply to a gait request."""

    request_id: int
    gait: Gait
    outcome: GaitOutcome
    reason: str = ""


class _FootEstimate:
    """Running mean of a standing foot's pose, which averages out measurement noise."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._position = [0.0, 0.0, 0.0]
        self.yaw = 0.0
        self.reset()

    @property
    def position(self) -> Array:
        """(3,) in world [m]."""
        return np.array(self._position)

    @property
    def height(self) -> float:
        """Of the sole in world [m]."""
        return self._position[2]

    def reset(self) -> None:
        self._count = 0

    def update(self, position: Array, yaw: float) -> None:
        self._count = min(self._count + 1, self._samples)
        gain = 1.0 / self._count
        # In plain numbers: for three of them numpy takes longer.
        (x, y, z), (a, b, c) = self._position, position.tolist()
        self._position = [x + gain * (a - x), y + gain * (b - y), z + gain * (c - z)]
        self.yaw = wrap_angle(self.yaw + gain * wrap_angle(yaw - self.yaw))


class Locomotion:
    """Pure state machine of standing and walking; call :meth:`update` once a tick.

    Attributes:
        state: discrete state.
        completed: gaits completed.
    """

    def __init__(self, config: WbcConfig) -> None:
        self._config = config
        samples = max(5, round(0.3 * config.rate))
        self._feet = (_FootEstimate(samples), _FootEstimate(samples))
        self._omega = natural_frequency(config.gait.com_height)
        self.state = ControlState.STAND
        self.completed = 0
        self._start_time: float | None = None
        self._takeover: Takeover | None = None
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
        """Gait in progress; NONE while standing."""
        return Gait.NONE if self._request is None else self._request[1]

    def request(self, request_id: int, gait: Gait) -> None:
        """Request a gait; the next :meth:`update` answers."""
        self._pending.append((request_id, gait))

    def answers(self) -> list[Answer]:
        """Return the answers since the last call, oldest first."""
        answers, self._answers = self._answers, []
        return answers

    def abort(self, reason: str) -> Answer | None:
        """Return the answer that aborts the gait in progress; None without one."""
        if self._request is None:
            return None
        return Answer(*self._request, GaitOutcome.ABORTED, reason)

    def progress(self, time: float) -> float:
        """Return the elapsed share of the gait in progress; 0 while standing."""
        if self._plan is None or self._request is None or self._start_time is None:
            return 0.0
        return min(1.0, max(0.0, (time - self._start_time) / self._plan.duration))

    def update(self, dynamics: Dynamics, foot_force: Array, time: float) -> BodyReference:
        """Advance to ``time`` and return the body's references.

        Args:
            dynamics: model terms at the measured state.
            foot_force: (2,) measured normal force of the left and the right foot [N].
            time: robot time [s].
        """
        self._observe_feet(dynamics)
        if self._takeover is None:
            self._takeover = Takeover(dynamics, foot_force, time, self._config)
            self.state = self._takeover.state(time)
        self._finish_gait(time)
        self._handle_requests(time)
        if self._anchor is None:
            reference = self._taking_over(self._takeover, dynamics.com_position, time)
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
            estimate.update(foot.position, yaw_from_matrix(foot.rotation))

    def _swinging_side(self) -> Side:
        return 0 if self.state is ControlState.LF_SWING else 1

    def _footprints(self) -> tuple[Footprint, Footprint]:
        left, right = self._feet
        return (
            Footprint(0, left.position[:2], left.yaw),
            Footprint(1, right.position[:2], right.yaw),
        )

    def _com_height(self) -> float:
        soles = 0.5 * (self._feet[0].height + self._feet[1].height)
        return soles + self._config.gait.com_height

    def _taking_over(self, takeover: Takeover, com: Array, time: float) -> BodyReference:
        self.state = takeover.state(time)
        stance = stance_between(*self._footprints())
        reference = takeover.reference(time, com, stance, self._com_height())
        if takeover.done(time):
            self.state = ControlState.BALANCE
            self._anchor = stance
        return reference

    def _balancing(self, time: float) -> BodyReference:
        if self._plan is not None and self._start_time is not None:
            return self._along_plan(self._plan, time - self._start_time, (None, None))
        assert self._anchor is not None
        com = np.array([*self._anchor.position, self._com_height()])
        return BodyReference(
            com,
            np.zeros(3),
            np.zeros(3),
            com[:2],
            heading(self._anchor.yaw),
            (None, None),
            force_limits((1.0, 1.0), self._config.contact.normal_force_max),
            (1.0, 1.0),
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
                start=foot.position,
                start_rotation=matrix_from_yaw(foot.yaw),
                end=np.array([*landing.position, other.height]),
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
        swing: SwingPair,
    ) -> BodyReference:
        target = plan.dcm.at(elapsed)
        load = (plan.load_at(0, elapsed), plan.load_at(1, elapsed))
        return BodyReference(
            np.array((*target.com.tolist(), self._last_height(swing))),
            np.array((*target.com_velocity.tolist(), 0.0)),
            np.array((*target.com_acceleration.tolist(), 0.0)),
            target.dcm,
            heading(*plan.yaw_at(elapsed)),
            swing,
            force_limits(load, self._config.contact.normal_force_max),
            load,
        )

    def _last_height(self, swing: SwingPair) -> float:
        """Return the CoM height above the standing soles, low-passed at steps in the ground."""
        soles = [foot.height for foot, s in zip(self._feet, swing, strict=True) if s is None]
        goal = sum(soles) / len(soles) + self._config.gait.com_height
        if self._last is None:
            return goal
        last = float(self._last.com[2])
        return last + (goal - last) * min(1.0, 5.0 / self._config.rate)

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
            return "NONE is not a gait; expected one of the six"
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
        """Return the stance that the next gait displaces.

        It is the planned end of the last gait, so that landing errors do not add up, unless the
        robot was pushed or slipped further than the tolerance: then it is the measured stance.
        """
        anchor, config = self._anchor, self._config.gait
        if anchor is None:
            return measured
        off = float(np.linalg.norm(measured.position - anchor.position))
        turned = abs(wrap_angle(measured.yaw - anchor.yaw))
        near = off <= config.anchor_distance and turned <= config.anchor_angle
        return anchor if near else measured
