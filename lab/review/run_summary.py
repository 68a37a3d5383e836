"""What ``summary.json`` says about a run; computed by :mod:`lab.review.summary`."""

from pydantic import BaseModel, ConfigDict, Field

from deploy.launch import Outcome


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Spread(_Part):
    """A sampled quantity; the unit stands in the name of the field that holds it."""

    samples: int = 0
    median: float = 0.0
    p99: float = 0.0
    maximum: float = 0.0


class GaitTally(_Part):
    """Counts of one gait type over the run."""

    requested: int = 0
    accepted: int = 0
    completed: int = 0
    refused: int = Field(default=0, description="refusals, a request may collect several")
    aborted: int = 0


class GaitRun(_Part):
    """One request and what came of it; motions in the robot's heading when it was accepted."""

    request_id: int
    gait: str
    outcome: str = Field(description="requested (no answer), refused, accepted, completed, aborted")
    reason: str = ""
    refusals: int = Field(default=0, description="times it was refused before this outcome")
    duration: float = Field(default=0.0, description="robot time from accepted to its end [s]")
    forward: float = Field(default=0.0, description="[m]")
    left: float = Field(default=0.0, description="[m]")
    turn_deg: float = 0.0
    commanded_forward: float = 0.0
    commanded_left: float = 0.0
    commanded_turn_deg: float = 0.0


class Walk(_Part):
    """All completed gaits together, from the first's acceptance to the last's completion.

    Positions are in the heading the robot had at the start.
    """

    distance: float = Field(default=0.0, description="sum over the gaits that go somewhere [m]")
    commanded_distance: float = 0.0
    forward: float = Field(default=0.0, description="end against start [m]")
    left: float = 0.0
    turn_deg: float = Field(default=0.0, description="sum over the gaits")
    commanded_forward: float = Field(default=0.0, description="by the commands one after another")
    commanded_left: float = 0.0
    commanded_turn_deg: float = 0.0
    end_error: float = Field(default=0.0, description="distance from the commanded end [m]")


class ServiceTiming(_Part):
    """A service's loop over the run, from its own health messages."""

    period_ms: float
    steps: int
    deadline_misses: int
    step_median_ms: float = Field(description="median over the windows it reported")
    step_p99_ms: float = Field(description="median of the windows' 99th percentiles")
    step_p99_worst_ms: float = Field(description="worst window's 99th percentile")
    cpu: float = Field(description="mean share of one core")
    realtime: str
    input_gaps: int = Field(description="messages its inputs missed by sequence number")
    input_refused: int = Field(description="undecodable or invalid messages on its inputs")


class TopicTally(_Part):
    """One topic as recorded."""

    messages: int
    rate: float = Field(description="[Hz], between its first and last message as sent")
    nominal_rate: float
    gaps: int = Field(description="missing in the log by sequence number")
    dropped: int = Field(default=0, description="arrived at the logger but not written")
    undecodable: int = Field(default=0, description="recorded, but of another schema or damaged")


class PlantTally(_Part):
    """The plant's own account."""

    falls: int = 0
    resets: int = 0
    holds: int = 0
    commands_applied: int = 0
    commands_refused: int = 0
    late_steps: int = 0
    saturated_fraction: float = Field(default=0.0, description="mean over the status messages")
    real_time_factor: float = Field(
        default=0.0, description="robot time / sender's time, whole run"
    )
    real_time_factor_worst: float = Field(default=0.0, description="worst second")
    age_at_torque_median_ms: float = Field(default=0.0, description="median over seconds")
    age_at_torque_p99_ms: float = Field(default=0.0, description="median over seconds")
    age_at_torque_p99_worst_ms: float = Field(default=0.0, description="worst second")


class Tracking(_Part):
    """The controller's own errors, while it balanced or walked."""

    hand_position_mm: Spread = Spread()
    hand_rotation_deg: Spread = Spread()
    dcm_mm: Spread = Spread()
    solver: str = ""
    unsolved: int = 0


class StageTally(_Part):
    """A step towards a task's goal."""

    name: str
    at: float | None = Field(description="when it was done, time of the trial [s]; None: never")


class ContactTally(_Part):
    """An undesired contact."""

    name: str = Field(description="for instance: left wrist on jamb")
    since: float = Field(description="first touch, time of the trial [s]")
    peak: float = Field(description="largest normal force [N]")


class TaskTrial(_Part):
    """One trial of a scored task, as the plant's judge saw it."""

    task: str
    seed: int
    verdict: str = Field(description="running (no verdict), success, partial or failure")
    time: float = Field(description="until the verdict, or so far [s]")
    limit: float = Field(description="[s]")
    reason: str = ""
    stages: list[StageTally]
    undesired: list[ContactTally]
    operator: str = Field(default="", description="what the operator said it was playing")


class RunSummary(_Part):
    """Everything worth knowing about one run, as written to ``summary.json``."""

    outcome: Outcome
    reason: str = ""
    duration: float = Field(description="robot time covered by the log [s]")
    gaits: dict[str, GaitTally]
    gait_runs: list[GaitRun]
    walk: Walk
    plant: PlantTally
    tracking: Tracking
    trials: list[TaskTrial] = Field(default=[], description="of the scored task, if there is one")
    services: dict[str, ServiceTiming]
    topics: dict[str, TopicTally]
    log_truncated: bool = Field(default=False, description="the logger was killed")
    environment: dict[str, str]
