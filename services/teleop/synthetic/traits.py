"""What kind of operator the synthetic one is: named sets of human-like parameters."""

from typing import Final

from pydantic import BaseModel, ConfigDict, Field


class OperatorTraits(BaseModel):
    """Perception, hands and habits of a synthetic operator.

    Orders of magnitude are those of people: simple reactions take 0.2 to 0.3 s, aimed reaches have
    bell-shaped speed and end a few per cent of their length beside the goal, a held hand trembles
    by a millimetre or two below 10 Hz.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(default="practised", max_length=40, description="of this kind of operator")
    reaction: float = Field(default=0.22, gt=0.0, description="median reaction time [s]")
    reaction_spread: float = Field(default=0.25, ge=0.0, description="of its logarithm")
    reach_speed: float = Field(default=0.22, gt=0.0, description="mean speed of a reach [m/s]")
    turn_speed: float = Field(default=1.0, gt=0.0, description="mean turning rate [rad/s]")
    shortest_reach: float = Field(default=0.4, gt=0.0, description="no move is quicker [s]")
    grip_time: float = Field(default=0.25, gt=0.0, description="to press or open a trigger [s]")
    press_time: float = Field(default=0.12, gt=0.0, description="a button is held [s]")
    aim_error: float = Field(
        default=0.03, ge=0.0, description="deviation of a reach's end, per metre of its length"
    )
    tremor: float = Field(default=0.0008, ge=0.0, description="of a held hand, per axis [m]")
    tremor_angle: float = Field(default=0.006, ge=0.0, description="likewise [rad]")
    head_sway: float = Field(default=0.01, ge=0.0, description="of the head, per axis [m]")
    head_turn: float = Field(default=0.03, ge=0.0, description="of the head, per axis [rad]")
    agreement: float = Field(
        default=0.015, gt=0.0, description="seen and expected hand this near are the same [m]"
    )
    agreement_angle: float = Field(default=0.2, gt=0.0, description="likewise [rad]")
    still: float = Field(default=0.03, gt=0.0, description="a hand seen slower rests [m/s]")
    patience: float = Field(
        default=0.6,
        gt=0.0,
        description="beyond the lag it is used to, before it takes a hand for blocked [s]",
    )
    answer_patience: float = Field(
        default=1.5, gt=0.0, description="likewise, before a button is pressed again [s]"
    )
    variety: float = Field(
        default=1.0, ge=0.0, description="of way-points, speeds and pauses; 0: always the same"
    )


TRAITS: Final[dict[str, OperatorTraits]] = {
    "practised": OperatorTraits(),
    "steady": OperatorTraits(
        name="steady", tremor=0.0, tremor_angle=0.0, aim_error=0.0, head_sway=0.0, head_turn=0.0
    ),
}
"""Named sets; ``steady`` has neither tremor nor aiming errors, for comparison."""
