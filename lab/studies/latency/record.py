"""The record of one trial of the study, whether the synthetic operator or a person did it."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from common.schemas import UndesiredContact

Operator = Literal["synthetic", "human"]

OWN_LATENCY: dict[Literal["command", "feedback"], float] = {"command": 0.05, "feedback": 0.1}
"""Largest latency of the system without an injected delay, also between machines [s].

Pictures, by which an operator sees the robot, may come only ten times a second.
"""
_TOLERATED_SHARE = 0.25
"""The measured mean latency may differ from the requested one by this share of it."""


class Record(BaseModel):
    """Base of what a study stores: frozen, without unknown fields, NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LinkLatency(Record):
    """Latency of one direction: what was requested, and what the consumer measured.

    The measured latency runs from sending a message to the step of the consumer that acted on it.

    Attributes:
        asked_mean: mean of the requested delay [s].
        asked_p99: 99th percentile of the requested delay [s].
        mean: mean of the measured latency [s]; None: no message was used.
        p99: 99th percentile of the measured latency [s].
        used: number of messages that were used.
        lost: number of messages that the link lost on purpose.
    """

    asked_mean: float = 0.0
    asked_p99: float = 0.0
    mean: float | None = None
    p99: float | None = None
    used: int = Field(default=0, ge=0)
    lost: int = Field(default=0, ge=0)

    def agrees(self, own: float) -> bool:
        """Whether the measured latency can come from the requested delay.

        Args:
            own: largest latency of the system without an injected delay [s].
        """
        if self.mean is None:
            return True
        jitter = self.asked_p99 - self.asked_mean
        tolerated = own + _TOLERATED_SHARE * self.asked_mean + jitter
        return abs(self.mean - self.asked_mean) <= tolerated

    @property
    def text(self) -> str:
        """In milliseconds, as ``250: 255/260``: requested mean, measured mean and percentile."""
        measured = "?"
        if self.mean is not None and self.p99 is not None:
            measured = f"{1e3 * self.mean:.0f}/{1e3 * self.p99:.0f}"
        return f"{1e3 * self.asked_mean:.0f}: {measured}"


class StudyTrial(Record):
    """One trial of the study.

    Attributes:
        operator: who did the trial; the two kinds are never pooled.
        participant: pseudonym of the person; empty for the synthetic operator.
        task: name of the task, for instance ``door/unlock``.
        condition: name of the condition.
        seed: seed of the start and of everything that varies in the synthetic operator.
        verdict: ``success``, ``partial``, ``failure``, or ``error`` if the simulation failed.
        time: robot time from start to verdict [s].
        limit: time limit of the task [s].
        reached: whether the goal was reached, with or without undesired contacts.
        reason: reason of the task's judge.
        gave_up: why the synthetic operator ended early; empty: it did not.
        doing: what the synthetic operator was doing at the end.
        stages: names of the completed stages.
        undesired: undesired contacts.
        command: latency from operator to robot.
        feedback: latency from robot to operator.
        hand_path: length of the path of both hands' set-points in the body frame [m].
        arm_acceleration: root mean square of the arms' joint accelerations, from measured
            velocities [rad/s²]; None: not measured.
        simulated: robot time that was run [s].
        wall: wall-clock time that this took [s].
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
    undesired: tuple[UndesiredContact, ...] = ()
    command: LinkLatency = LinkLatency()
    feedback: LinkLatency = LinkLatency()
    hand_path: float | None = None
    arm_acceleration: float | None = None
    simulated: float = 0.0
    wall: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Participant, task, condition and seed, which identify a trial."""
        return self.participant, self.task, self.condition, self.seed

    @property
    def charged(self) -> float:
        """Completion time [s]; the time limit if the goal was not reached."""
        return self.time if self.reached else self.limit
