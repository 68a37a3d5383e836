"""Measures a trial from its messages and makes its record."""

from collections.abc import Sequence
from typing import Any

from common.schemas import Message, PlantState, Setpoint, StepJournal, TaskStatus
from common.topics import JOURNAL, PLANT_STATE, TELEOP_SETPOINT, Topic
from lab.studies.latency.conditions import COMMAND_INPUT, Condition
from lab.studies.latency.latencies import Input, Latencies, mean_p99
from lab.studies.latency.motion import HandMotion
from lab.studies.latency.record import LinkLatency

MEASURED_TOPICS: tuple[Topic[Any], ...] = (JOURNAL, TELEOP_SETPOINT, PLANT_STATE)
"""The topics whose messages :class:`TrialMeter` uses."""


class TrialMeter:
    """Measures latencies and hand motion of one trial.

    Attributes:
        latencies: latencies of all inputs.
        motion: motion of the hands.
    """

    def __init__(self) -> None:
        self.latencies = Latencies()
        self.motion = HandMotion()

    def add(self, topic: Topic[Any], message: Message) -> None:
        """Add a message; those of other topics than :data:`MEASURED_TOPICS` are ignored."""
        if topic is JOURNAL and isinstance(message, StepJournal):
            self.latencies.add(message)
        elif topic is TELEOP_SETPOINT and isinstance(message, Setpoint):
            self.motion.add_setpoint(message)
        elif topic is PLANT_STATE and isinstance(message, PlantState):
            self.motion.add_state(message)

    def values(self, condition: Condition, feedback_inputs: Sequence[Input]) -> dict[str, Any]:
        """Return the measured fields of the trial's record.

        Args:
            condition: the condition of the trial.
            feedback_inputs: inputs by which the operator may have seen the robot; the first that
                has latencies counts.
        """
        used = (at for at in feedback_inputs if self.latencies.of(*at))
        return {
            "command": link_latency(self.latencies, condition, COMMAND_INPUT),
            "feedback": link_latency(self.latencies, condition, next(used, feedback_inputs[0])),
            "hand_path": self.motion.hand_path,
            "arm_acceleration": self.motion.arm_acceleration,
        }


def link_latency(latencies: Latencies, condition: Condition, at: Input) -> LinkLatency:
    """Summarise the latencies of the input ``at`` beside the delay that ``condition`` requests."""
    asked_mean, asked_p99 = condition.asked(*at)
    found = latencies.of(*at)
    mean, p99 = mean_p99(found) or (None, None)
    return LinkLatency(
        asked_mean=asked_mean,
        asked_p99=asked_p99,
        mean=mean,
        p99=p99,
        used=len(found),
        lost=latencies.lost(*at),
    )


def judged_values(status: TaskStatus) -> dict[str, Any]:
    """Return the fields of a trial's record that the judge's last status decides."""
    return {
        "reached": bool(status.stages) and status.stages[-1].done,
        "stages": tuple(stage.name for stage in status.stages if stage.done),
        "undesired": tuple(status.undesired),
        "time": status.time,
        "limit": status.limit,
        "verdict": status.verdict.name.lower(),
        "reason": status.reason,
    }
