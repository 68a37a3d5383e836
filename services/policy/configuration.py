"""Configuration that all kinds of policy share; the defaults are the paper's network.

The paper is Seo et al., "Deep Imitation Learning for Humanoid Loco-manipulation through Human
Teleoperation" (TRILL), with its public code where it is silent. Nothing here needs torch.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from common.episodes.columns import BY_PATH
from common.schemas import ControlState

Profile = Literal["cpu", "paper"]
"""``cpu`` is learned and served by a processor core, ``paper`` is the paper's network."""
Cameras = tuple[Literal["left", "right"], ...]


class StrictModel(BaseModel):
    """Base of the configuration's and a checkpoint's tables: frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class InputConfig(StrictModel):
    """What a policy observes in each frame."""

    vision: Literal["stereo", "monoscopic", "blind"] = Field(
        default="stereo", description="both pictures, the right one as in the ablation, or none"
    )
    picture_size: tuple[Annotated[int, Field(ge=8)], Annotated[int, Field(ge=8)]] = Field(
        default=(400, 300), description="width and height to which pictures are scaled [pixels]"
    )
    body_poses: bool = Field(
        default=True,
        description="measured poses of hands and feet; false: without joint_state and "
        "gripper_closure nothing that joints measure is left",
    )
    joint_state: bool = Field(
        default=True, description="joint positions and velocities; false: the paper's ablation"
    )
    gripper_closure: bool = Field(default=False, description="measured closures; not in the paper")
    previous_setpoint: bool = Field(
        default=False, description="hand set-points of the frame before; not in the paper"
    )
    scene: tuple[str, ...] = Field(
        default=(), description="names of numbers of the scene, told by a simulator"
    )
    estimated: tuple[str, ...] = Field(
        default=(),
        description="names of numbers of the scene that the network estimates from the pictures: "
        "it has learned them from a simulator, and nothing else of the pictures is used",
    )

    @model_validator(mode="after")
    def _pictures_to_estimate_from(self) -> Self:
        if self.estimated and not self.cameras:
            raise ValueError(
                'expected vision "stereo" or "monoscopic" to estimate the scene from, got "blind"'
            )
        return self

    @model_validator(mode="after")
    def _something_measured(self) -> Self:
        if not self.measured_width:
            raise ValueError("expected body_poses, joint_state or another input, got none")
        return self

    @property
    def cameras(self) -> Cameras:
        """Cameras whose pictures the policy sees."""
        cameras: dict[str, Cameras] = {"stereo": ("left", "right"), "monoscopic": ("right",)}
        return cameras.get(self.vision, ())

    @property
    def parts(self) -> dict[str, int]:
        """Parts of the observation vector by name, and how many numbers each has, in order.

        The last one is the controller's discrete state, one number for each value.
        """
        measured = {
            "observation/poses": self.body_poses,
            "observation/joint_sin_cos": self.joint_state,
            "observation/joint_velocity": self.joint_state,
            "observation/gripper_closure": self.gripper_closure,
        }
        found = {path: _width(path) for path, wanted in measured.items() if wanted}
        if self.previous_setpoint:
            # Positions and rotation vectors of two hands.
            found["previous_setpoint"] = 12
        if self.scene:
            found["scene"] = len(self.scene)
        return found | {"observation/control_state": len(ControlState)}

    @property
    def width(self) -> int:
        """Length of the observation vector."""
        return sum(self.parts.values())

    @property
    def measured_width(self) -> int:
        """How many of its numbers are measured, all but the controller's state."""
        return self.width - len(ControlState)


def _width(path: str) -> int:
    return len(BY_PATH[path].names)


class _EncoderConfig(StrictModel):
    key_points: int = Field(default=32, ge=1, description="channels of the spatial soft-max")
    features: int = Field(default=64, ge=1, description="numbers that describe a picture")


class ResNetConfig(_EncoderConfig):
    """ResNet18, spatial soft-max and a linear layer, one for each camera."""

    kind: Literal["resnet18"] = "resnet18"
    width: int = Field(default=64, ge=1, description="channels of the first layer")


class ConvolutionConfig(_EncoderConfig):
    """A few convolutions, spatial soft-max and a linear layer, one for each camera.

    The first kernel is 5x5, the others 3x3.
    """

    kind: Literal["convolutions"] = "convolutions"
    channels: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(16, 32, 32, 32), min_length=1, description="of each layer"
    )
    strides: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(2, 2, 1, 1), description="of each layer"
    )

    @model_validator(mode="after")
    def _one_stride_a_layer(self) -> Self:
        if len(self.strides) != len(self.channels):
            raise ValueError(
                f"expected as many strides as channels, got {len(self.strides)} strides and "
                f"{len(self.channels)} channels"
            )
        return self


class EstimatorConfig(StrictModel):
    """The layer between the encoders and the estimated numbers of the scene."""

    hidden: int = Field(default=128, ge=1, description="units")


class MemoryConfig(StrictModel):
    """The LSTM."""

    layers: int = Field(default=2, ge=1, description="layers")
    hidden: int = Field(default=400, ge=1, description="units of a layer")


class MixtureConfig(StrictModel):
    """The Gaussian mixture of the hands."""

    modes: int = Field(default=5, ge=1, description="number of Gaussians")
    minimum_std: float = Field(
        default=0.03, gt=0.0, description="added to the standard deviations, normalised actions"
    )


class DifferenceConfig(StrictModel):
    """Hand actions as pose differences from the previous set-point, as in the paper."""

    kind: Literal["differences"] = "differences"

    @property
    def shape(self) -> tuple[int, int]:
        """Steps, and numbers of each: position and quaternion of two hands."""
        return (1, 14)


class ChunkConfig(StrictModel):
    """Hand and neck actions as the next absolute set-points; not in the paper."""

    kind: Literal["chunks"] = "chunks"
    steps: int = Field(default=20, ge=1, description="set-points in a chunk, 20 a second")
    active_time: bool = Field(
        default=True,
        description="the label is the next frames in which a hand or gripper moves or the robot "
        "walks, so that the pauses of the demonstrations are not learned",
    )
    execute: int = Field(
        default=5,
        ge=1,
        description="steps of a chunk that are carried out before the next one, in service unless "
        "configured there; more get past moments at which a policy hesitates",
    )

    @property
    def shape(self) -> tuple[int, int]:
        """Steps, and numbers of each: position and rotation vector of two hands, and the neck."""
        return (self.steps, 13)


class LossConfig(StrictModel):
    """Weights of the terms of the loss, and how the gait trigger is trained."""

    hands: float = Field(default=1.0, ge=0.0, description="negative log-likelihood of a set-point")
    grasp: float = Field(default=1.0, ge=0.0, description="cross-entropy of the grippers")
    trigger: float = Field(default=1.0, ge=0.0, description="cross-entropy of the gait trigger")
    gait: float = Field(default=1.0, ge=0.0, description="cross-entropy of the type of gait")
    hazard_frames: int = Field(
        default=0,
        ge=0,
        description="so many frames before a request count as requests too, and only frames in "
        "balance are learned from; 0: the frame of the request, all frames, as in the paper",
    )


class PolicySettings(StrictModel):
    """What every kind of policy has."""

    inputs: InputConfig = InputConfig()
    encoder: Annotated[ResNetConfig | ConvolutionConfig, Field(discriminator="kind")] = (
        ResNetConfig()
    )
    estimator: EstimatorConfig = EstimatorConfig()
    mlp: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(1024, 1024), min_length=1, description="units of the layers after the memory"
    )
    mixture: MixtureConfig = MixtureConfig()
    deterministic: bool = Field(
        default=False, description="one set-point and its squared error in place of the mixture"
    )
    actions: Annotated[DifferenceConfig | ChunkConfig, Field(discriminator="kind")] = (
        DifferenceConfig()
    )
    loss: LossConfig = LossConfig()

    @property
    def recurrence(self) -> MemoryConfig | None:
        """The LSTM; None: the policy is reactive."""
        return None

    @property
    def memory_shape(self) -> tuple[int, int, int]:
        """Shape of the recurrent state: hidden and cell, layers, units; empty without an LSTM.

        It is one float32 array, zero at the start, that may travel with a request.
        """
        lstm = self.recurrence
        return (2, lstm.layers, lstm.hidden) if lstm else (2, 0, 0)

    @classmethod
    def profile(cls, name: Profile) -> Self:
        """Return the configuration of a profile."""
        # A reactive policy has no memory to be chosen.
        known = {key: part for key, part in _PROFILES[name].items() if key in cls.model_fields}
        return cls(**known)


class RecurrentSettings(PolicySettings):
    """What every kind of policy with a memory has."""

    memory: MemoryConfig = MemoryConfig()

    @property
    def recurrence(self) -> MemoryConfig | None:
        """The LSTM."""
        return self.memory


_PROFILES: dict[Profile, dict[str, Any]] = {
    "paper": {},
    "cpu": {
        "inputs": InputConfig(picture_size=(60, 45)),
        "encoder": ConvolutionConfig(
            channels=(12, 24, 24), strides=(2, 1, 1), key_points=16, features=32
        ),
        "memory": MemoryConfig(layers=1, hidden=128),
        "mlp": (256, 256),
    },
}
