"""Schema of ``summary.json``, the numbers of one run; :mod:`lab.review.summary` computes them."""

from collections.abc import Iterable
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.order_statistics import Parts, quantiles
from common.schemas import UndesiredContact
from deploy.launch import Outcome


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantiles(_Part):
    """Distribution of a sampled quantity, in the unit that the name of its field ends in."""

    samples: int = 0
    median: float = 0.0
    p99: float = 0.0
    maximum: float = 0.0

    @classmethod
    def of(cls, samples: Iterable[float]) -> Self:
        """Compute median, 99th percentile and maximum; all are zero without samples."""
        values = np.fromiter(samples, dtype=np.float64)
        return cls.of_parts(lambda: [values])

    @classmethod
    def of_parts(cls, samples: Parts) -> Self:
        """Compute the same of samples that do not fit in memory."""
        count = sum(map(len, samples()))
        if not count:
            return cls()
        median, p99, maximum = quantiles(samples, count, (0.5, 0.99, 1.0))
        return cls(samples=count, median=median, p99=p99, maximum=maximum)


class GaitCounts(_Part):
    """Counts of the requests of one gait type."""

    requested: int = 0
    accepted: int = 0
    completed: int = 0
    refused: int = Field(default=0, description="refusals; one request may collect several")
    aborted: int = 0


class GaitRun(_Part):
    """One gait request and its outcome; motions are in the robot's frame at its acceptance."""

    request_id: int
    gait: str
    outcome: str = Field(
        description="requested (no reply), refused, accepted, completed or aborted"
    )
    reason: str = ""
    refusals: int = Field(default=0, description="times it was refused before this outcome")
    duration: float = Field(default=0.0, description="robot time from acceptance to end [s]")
    forward: float = Field(default=0.0, description="[m]")
    left: float = Field(default=0.0, description="[m]")
    turn_deg: float = 0.0
    commanded_forward: float = 0.0
    commanded_left: float = 0.0
    commanded_turn_deg: float = 0.0


class Walk(_Part):
    """Motion from the acceptance of the first completed gait to the completion of the last one.

    Positions are in the robot's frame at the start.
    """

    distance: float = Field(default=0.0, description="sum over the gaits that change position [m]")
    commanded_distance: float = 0.0
    forward: float = Field(default=0.0, description="end relative to start [m]")
    left: float = 0.0
    turn_deg: float = Field(default=0.0, description="sum over the gaits")
    commanded_forward: float = Field(default=0.0, description="sum of the commands")
    commanded_left: float = 0.0
    commanded_turn_deg: float = 0.0
    end_error: float = Field(default=0.0, description="distance from the commanded end [m]")


class ServiceTiming(_Part):
    """Timing of a service's loop, from its health messages; each covers a window of time."""

    period_ms: float
    steps: int
    deadline_misses: int
    step_median_ms: float = Field(description="median of the windows' medians")
    step_p99_ms: float = Field(description="median of the windows' 99th percentiles")
    step_p99_worst_ms: float = Field(description="largest 99th percentile of a window")
    cpu: float = Field(description="mean share of one core")
    realtime: str
    lives: int = Field(default=1, description="times it was started; counts are over all lives")
    input_gaps: int = Field(description="messages its inputs missed, by sequence number")
    input_refused: int = Field(description="undecodable or invalid messages on its inputs")


class TopicStats(_Part):
    """Messages of one topic in the log."""

    messages: int
    rate: float = Field(description="while its publishers sent, from their first to last [Hz]")
    nominal_rate: float
    gaps: int = Field(description="lost on the way while the logger ran, by sequence number")
    dropped: int = Field(default=0, description="received by the logger but not written")
    undecodable: int = Field(default=0, description="damaged, or of another schema version")


class PlantStats(_Part):
    """Counts and timing that the plant reported, over all its lives."""

    lives: int = Field(default=1, description="times it was started")
    falls: int = 0
    stops: int = Field(default=0, description="emergency stops that it latched")
    resets: int = 0
    holds: int = 0
    commands_applied: int = 0
    commands_refused: int = 0
    late_steps: int = 0
    saturated_fraction: float = Field(default=0.0, description="mean of the status messages")
    real_time_factor: float = Field(default=0.0, description="of the whole run")
    real_time_factor_worst: float = Field(default=0.0, description="of the worst second")
    age_at_torque_median_ms: float = Field(default=0.0, description="median of all seconds")
    age_at_torque_p99_ms: float = Field(default=0.0, description="median of all seconds")
    age_at_torque_p99_worst_ms: float = Field(default=0.0, description="of the worst second")


class Tracking(_Part):
    """Tracking errors that the controller reported."""

    hand_position_mm: Quantiles = Quantiles()
    hand_rotation_deg: Quantiles = Quantiles()
    dcm_mm: Quantiles = Quantiles()
    solver: str = ""
    unsolved: int = 0


class StageResult(_Part):
    """A stage of a task."""

    name: str
    at: float | None = Field(description="trial time at which it was done [s]; None: never")


class TaskTrial(_Part):
    """One trial of a scored task, as the judge in the plant saw it."""

    task: str
    seed: int
    verdict: str = Field(description="running (no verdict), success, partial or failure")
    time: float = Field(description="trial time of the verdict, or of the last status [s]")
    limit: float = Field(description="[s]")
    reason: str = ""
    stages: list[StageResult]
    undesired: list[UndesiredContact]
    operator: str = Field(default="", description="script that the operator reported")


class Event(_Part):
    """A stop, the end of one, or a change of who has the robot."""

    at: float = Field(description="robot time since the first state [s]")
    text: str


class Intervention(_Part):
    """A span in which another operator had the robot in place of a policy."""

    operator: str = Field(description="source and kind, for instance teleop (person)")
    at: float = Field(description="robot time since the first state [s]")
    length: float = Field(description="robot time [s]")
    until: str = Field(description="why it ended; empty: it had not when the run ended")


class RunSummary(_Part):
    """Numbers of one run, as written to ``summary.json``."""

    outcome: Outcome
    reason: str = ""
    duration: float = Field(description="robot time, over all lives and resets of the plant [s]")
    gaits: dict[str, GaitCounts]
    gait_runs: list[GaitRun]
    walk: Walk
    plant: PlantStats
    tracking: Tracking
    trials: list[TaskTrial] = Field(default=[], description="of the scored task; empty without one")
    events: list[Event] = Field(default=[], description="stops and hand-overs, in order")
    interventions: list[Intervention] = Field(
        default=[], description="of persons and scripts in the work of a policy, in order"
    )
    services: dict[str, ServiceTiming]
    topics: dict[str, TopicStats]
    log_truncated: bool = Field(
        default=False, description="the logger was killed before it could write the end"
    )
    log_remarks: list[str] = Field(
        default=[], description="pauses of the recording, missing and foreign files"
    )
    environment: dict[str, str]
