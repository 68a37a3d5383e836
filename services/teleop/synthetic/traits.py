"""Parameters of the synthetic operator: perception, motion and habits of a person."""

from typing import Final

from pydantic import BaseModel, ConfigDict, Field


class OperatorTraits(BaseModel):
    """Parameters of a synthetic operator.

    Their orders of magnitude are those of people: simple reactions take 0.2 to 0.3 s, aimed reaches
    have a bell-shaped speed profile and miss the goal by a few per cent of their length, a held
    hand trembles by a millimetre or two below 10 Hz. Tremor, sway, errors and slips are standard
    deviations.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(default="practised", max_length=40, description="of this kind of operator")
    reaction: float = Field(default=0.22, gt=0.0, description="median reaction time [s]")
    reaction_spread: float = Field(
        default=0.25, ge=0.0, description="standard deviation of its logarithm"
    )
    reach_speed: float = Field(default=0.22, gt=0.0, description="mean speed of a reach [m/s]")
    turn_speed: float = Field(default=1.0, gt=0.0, description="mean turning rate [rad/s]")
    shortest_reach: float = Field(
        default=0.4, gt=0.0, description="shortest duration of a reach [s]"
    )
    grip_time: float = Field(default=0.25, gt=0.0, description="to press or release a trigger [s]")
    press_time: float = Field(default=0.12, gt=0.0, description="for which a button is held [s]")
    aim_error: float = Field(
        default=0.03, ge=0.0, description="standard deviation of a reach's end / its length"
    )
    tremor: float = Field(default=0.0008, ge=0.0, description="of a held hand, per axis [m]")
    tremor_angle: float = Field(default=0.006, ge=0.0, description="likewise [rad]")
    head_sway: float = Field(default=0.01, ge=0.0, description="of the head, per axis [m]")
    head_turn: float = Field(default=0.03, ge=0.0, description="of the head, per axis [rad]")
    agreement: float = Field(
        default=0.015, gt=0.0, description="tolerance between observed and expected hand [m]"
    )
    agreement_angle: float = Field(default=0.2, gt=0.0, description="likewise [rad]")
    still: float = Field(default=0.03, gt=0.0, description="a slower hand is at rest [m/s]")
    patience: float = Field(
        default=0.6,
        gt=0.0,
        description="time beyond the usual lag after which a hand counts as blocked [s]",
    )
    answer_patience: float = Field(
        default=1.5, gt=0.0, description="likewise, until a button is pressed again [s]"
    )
    slips: float = Field(
        default=0.0,
        ge=0.0,
        description="how often a hand is knocked off its way, from which it comes back [1/s]",
    )
    slip: float = Field(default=0.02, ge=0.0, description="how far, per axis [m]")
    slip_angle: float = Field(default=0.1, ge=0.0, description="likewise [rad]")
    variety: float = Field(
        default=1.0, ge=0.0, description="scale of variation in way-points and speeds; 0: none"
    )


TRAITS: Final[dict[str, OperatorTraits]] = {
    "practised": OperatorTraits(),
    "steady": OperatorTraits(
        name="steady", tremor=0.0, tremor_angle=0.0, aim_error=0.0, head_sway=0.0, head_turn=0.0
    ),
    "jostled": OperatorTraits(name="jostled", slips=0.3),
}
"""Named sets; ``steady`` has neither tremor nor aiming errors, for comparison. The hands of the
``jostled`` one are knocked off their way every few seconds, so that its demonstrations show how to
come back; the idea is that of DART (Laskey et al., "DART: Noise Injection for Robust Imitation
Learning", 2017), which disturbs a demonstrator with noise."""
