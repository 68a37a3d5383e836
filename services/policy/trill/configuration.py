"""Configuration of TRILL."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from services.policy.configuration import RecurrentSettings, StrictModel


class GaitNetworkConfig(StrictModel):
    """Trigger and type of gait have a network of their own, which sees one frame at a time.

    A demonstration has hundreds of set-points and a handful of requests. In a network that they
    share, the set-points decide what is looked at, and with a memory the requests are soon learned
    by heart.
    """

    layers: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(128, 128), min_length=1, description="units of its layers"
    )
    observes: tuple[Literal["observation/gripper_closure", "previous_setpoint", "scene"], ...] = (
        Field(
            default=("observation/gripper_closure", "previous_setpoint", "scene"),
            description="which parts of the observation it is given, if the policy has them, "
            "beside what is estimated of the scene; few, as there are few requests to learn from",
        )
    )


class TrillConfig(RecurrentSettings):
    """TRILL: a mixture for the hands; grasp, gait trigger and type of gait have their own heads."""

    kind: Literal["trill"] = "trill"
    categorical: bool = Field(
        default=False,
        description="one choice among no gait and the gaits, in place of trigger and type: the "
        "paper's ablation",
    )
    gait_network: GaitNetworkConfig | None = Field(
        default=None,
        description="a network of their own for trigger and type of gait; null: outputs beside "
        "those of the hands, as in the paper",
    )

    @model_validator(mode="after")
    def _one_frame_tells_the_scene(self) -> Self:
        inputs = self.inputs
        if self.gait_network is not None and inputs.cameras and not inputs.estimated:
            raise ValueError(
                "expected gait_network null, or inputs.estimated: a network of their own for the "
                "gaits takes from pictures what is estimated, and not features that are learned "
                "for the hands"
            )
        return self
