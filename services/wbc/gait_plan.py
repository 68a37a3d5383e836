"""Plan of a gait: phases with discrete states, contact schedule, footprints and DCM references."""

from dataclasses import dataclass

import numpy as np

from common.robot.rotations import wrap_angle
from common.schemas import ControlState, Gait
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import GaitConfig
from services.wbc.dcm import DcmPlan, DcmTiming, natural_frequency, plan_dcm
from services.wbc.footsteps import (
    Footprint,
    Side,
    Stance,
    gait_displacement,
    plan_footsteps,
    stance_between,
)
from services.wbc.swing import minimum_jerk

_START = (ControlState.LF_CONTACT_TRANSITION_START, ControlState.RF_CONTACT_TRANSITION_START)
_END = (ControlState.LF_CONTACT_TRANSITION_END, ControlState.RF_CONTACT_TRANSITION_END)
_SWING = (ControlState.LF_SWING, ControlState.RF_SWING)


@dataclass(frozen=True)
class Phase:
    """Interval of a gait in one discrete state.

    Attributes:
        state: discrete state, as in the paper.
        start, end: times since the start of the gait [s].
        foot: foot that is, or will next be, unloaded or swung (0 left, 1 right).
        step: index of the step.
    """

    state: ControlState
    start: float
    end: float
    foot: Side
    step: int


@dataclass(frozen=True)
class GaitPlan:
    """Plan of one gait, computed when it is accepted.

    Attributes:
        gait: one of the six.
        phases: in order of time.
        footprints: landing poses of the two steps.
        target: stance at the end.
        dcm: CoM and DCM references.
        yaw_start: torso heading at the start [rad].
        yaw_change: change of the torso heading [rad].
        config: geometry and timing.
    """

    gait: Gait
    phases: tuple[Phase, ...]
    footprints: tuple[Footprint, ...]
    target: Stance
    dcm: DcmPlan
    yaw_start: float
    yaw_change: float
    config: GaitConfig

    @property
    def duration(self) -> float:
        """Duration from acceptance to completion [s]."""
        return self.phases[-1].end

    def phase_at(self, time: float) -> Phase:
        """Return the phase at ``time`` [s] since the start."""
        for phase in self.phases:
            if time < phase.end:
                return phase
        return self.phases[-1]

    def yaw_at(self, time: float) -> tuple[float, float, float]:
        """Return torso heading, rate and acceleration [rad]; each swing turns it by half."""
        yaw, rate, acceleration = self.yaw_start, 0.0, 0.0
        for phase in self.phases:
            if phase.state not in _SWING or time < phase.start:
                continue
            length = phase.end - phase.start
            s, sd, sdd = minimum_jerk((time - phase.start) / length, length)
            half = 0.5 * self.yaw_change
            yaw, rate, acceleration = yaw + half * s, rate + half * sd, acceleration + half * sdd
        return yaw, rate, acceleration

    def load_at(self, side: Side, time: float) -> float:
        """Return the scheduled load of a foot, 0 (in the air) to 1 (fully loaded)."""
        load = 1.0
        config = self.config
        for index, phase in enumerate(self.phases):
            if phase.foot != side or time < phase.start:
                continue
            share = min(1.0, (time - phase.start) / (phase.end - phase.start))
            if phase.state in _END:
                load = 1.0 - share
            elif phase.state in _SWING:
                landed = time - phase.end
                following = self.phases[index + 1]
                window = config.double_support if phase.step == 0 else config.final_transfer
                window = min(config.load_fraction * window, following.end - following.start)
                load = 0.0 if landed < 0.0 else min(1.0, landed / window)
        return load


def plan_gait(
    gait: Gait,
    measured: tuple[Footprint, Footprint],
    anchor: Stance,
    com: Array,
    dcm: Array,
    config: GaitConfig,
) -> GaitPlan:
    """Plan a gait.

    Args:
        gait: one of the six.
        measured: present footprints of the left and the right foot.
        anchor: stance that the gait displaces.
        com: (2,) present CoM reference, not its measurement, so that the reference does not jump.
        dcm: (2,) present DCM reference.
        config: geometry and timing.
    """
    prints = plan_footsteps(gait, anchor, config)
    first, second = prints
    # During the first swing the robot stands on the other foot where it is now.
    stances = [measured[second.side].position, first.position]
    left, right = (first, second) if first.side == 0 else (second, first)
    target = stance_between(left, right)
    timing = DcmTiming(
        config.initial_transfer,
        config.single_support,
        config.double_support,
        config.final_transfer,
        config.settle,
    )
    omega = natural_frequency(config.com_height)
    yaw_now = stance_between(measured[0], measured[1]).yaw
    change = wrap_angle(target.yaw - yaw_now)
    if abs(gait_displacement(gait, config)[2]) == 0.0 and abs(change) > np.pi / 2:
        change = 0.0
    return GaitPlan(
        gait=gait,
        phases=_phases(first.side, second.side, config),
        footprints=(first, second),
        target=target,
        dcm=plan_dcm(com, dcm, stances, target.position, timing, omega),
        yaw_start=yaw_now,
        yaw_change=change,
        config=config,
    )


def _phases(first: Side, second: Side, config: GaitConfig) -> tuple[Phase, ...]:
    unload = config.unload_fraction
    lengths: list[tuple[ControlState, float, Side, int]] = []
    for step, foot, transfer in (
        (0, first, config.initial_transfer),
        (1, second, config.double_support),
    ):
        lengths += [
            (_START[foot], (1.0 - unload) * transfer, foot, step),
            (_END[foot], unload * transfer, foot, step),
            (_SWING[foot], config.single_support, foot, step),
        ]
    lengths.append((_START[first], config.final_transfer + config.settle, first, 2))
    phases: list[Phase] = []
    time = 0.0
    for state, length, foot, step in lengths:
        phases.append(Phase(state, time, time + length, foot, step))
        time += length
    return tuple(phases)
