"""What is kept of a trial, the synthetic operator's and a person's alike."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from common.schemas import TaskStatus
from lab.studies.latency.conditions import Condition
from lab.studies.latency.latencies import Input, Latencies, mean_p99

Operator = Literal["synthetic", "human"]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


OWN_COMMAND = 0.05
"""A set-point takes this long at most by itself, between two machines too [s]."""
OWN_FEEDBACK = 0.1
"""Likewise what the operator sees: pictures may come but ten times a second."""
_SHARE = 0.25


class LinkTake(_Record):
    """Latency of one direction: asked for, and what the consumer got.

    Attributes:
        asked_mean: injected, as asked for [s].
        asked_p99: its 99th percentile [s].
        mean: from sending a message to the step of the consumer that acted on it, measured at
            the consumer [s]; None: it acted on none.
        p99: 99th percentile of the same [s].
        used: messages it acted on.
        lost: messages the link lost on purpose.
    """

    asked_mean: float = 0.0
    asked_p99: float = 0.0
    mean: float | None = None
    p99: float | None = None
    used: int = Field(default=0, ge=0)
    lost: int = Field(default=0, ge=0)

    def agrees(self, own: float) -> bool:
        """Whether what was measured can be what was asked for.

        Args:
            own: what the system takes by itself at most [s].
        """
        if self.mean is None:
            return True
        jitter = self.asked_p99 - self.asked_mean
        return abs(self.mean - self.asked_mean) <= own + _SHARE * self.asked_mean + jitter


class Touched(_Record):
    """An undesired contact: first touch [s], largest normal force [N]."""

    name: str
    since: float
    peak: float


class TrialRow(_Record):
    """One trial.

    Attributes:
        operator: who did it; the two are never pooled.
        participant: pseudonym of a person; empty for the synthetic operator.
        task: for instance ``door/unlock``.
        condition: its name.
        seed: of the trial's start, and of everything that varies in the synthetic operator.
        verdict: ``success``, ``partial``, ``failure``, or ``error`` of the simulation itself.
        time: from start to verdict [s].
        limit: the task's time limit [s].
        reached: whether the goal was reached, with undesired contacts or without.
        reason: the judge's.
        gave_up: why the synthetic operator ended early; empty: it did not.
        doing: what the synthetic operator was doing at the end.
        stages: names of those done.
        undesired: contacts that should not have been.
        command: the way from operator to robot.
        feedback: the way back.
        hand_path: length of the ways both hands were told to go, in the body frame [m].
        arm_acceleration: root mean square over the arms' joints and time, of measured joint
            velocities [rad/s²]; None where not measured.
        simulated: robot time run [s].
        wall: time it took [s].
    """

    operator: Operator = "synthetic"
    participant: str = Field(default="", max_length=40)
    task: str
    condition: str
    seed: int = Field(ge=0)
    verdict: Literal["success", "partial", "failure", "error"]
    time: float = Field(ge=0.0)
    limit: float = Field(gt=0.0)
    reached: bool
    reason: str
    gave_up: str = ""
    doing: str = ""
    stages: tuple[str, ...] = ()
    undesired: tuple[Touched, ...] = ()
    command: LinkTake = LinkTake()
    feedback: LinkTake = LinkTake()
    hand_path: float | None = None
    arm_acceleration: float | None = None
    simulated: float = 0.0
    wall: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Participant, task, condition, seed: there is one trial of each."""
        return self.participant, self.task, self.condition, self.seed

    @property
    def charged(self) -> float:
        """Completion time [s]; the time limit where the goal was not reached."""
        return self.time if self.reached else self.limit


def link_take(latencies: Latencies, condition: Condition, at: Input) -> LinkTake:
    """Sum up one direction of a trial.

    Args:
        latencies: has taken in the trial's journals.
        condition: what was asked for.
        at: consumer and topic.
    """
    asked_mean, asked_p99 = condition.asked(*at)
    found = latencies.of(*at)
    mean, p99 = mean_p99(found) or (None, None)
    return LinkTake(
        asked_mean=asked_mean,
        asked_p99=asked_p99,
        mean=mean,
        p99=p99,
        used=len(found),
        lost=latencies.lost(*at),
    )


def judged(status: TaskStatus) -> dict[str, object]:
    """What the judge's last word says of stages and contacts."""
    return {
        "reached": bool(status.stages) and status.stages[-1].done,
        "stages": tuple(stage.name for stage in status.stages if stage.done),
        "undesired": tuple(
            Touched(name=touch.name, since=touch.since, peak=touch.peak)
            for touch in status.undesired
        ),
    }
