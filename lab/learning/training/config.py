"""Settings of training: all that decides, with the policy's settings, what is learned."""

from typing import Literal

from pydantic import Field

from services.policy.configuration import StrictModel


class NoiseConfig(StrictModel):
    """Noise on what the network observes; what it is to do stays as it is.

    Without it a policy learns that its hands go on as they go, and that they are always where the
    demonstrator had them. Constant noise is one draw for a window, white noise one for each frame.
    """

    hand: float = Field(default=0.0, ge=0.0, description="constant, on measured hands [m]")
    hand_white: float = Field(default=0.0, ge=0.0, description="white, on measured hands [m]")
    setpoint: float = Field(default=0.0, ge=0.0, description="constant, previous set-points [m]")
    turn: float = Field(
        default=0.0,
        ge=0.0,
        description="constant, on orientations of measured hands and of previous set-points [rad]; "
        "what hardly changes within a demonstration tells which one it is, and is learned by heart",
    )
    foot: float = Field(
        default=0.0, ge=0.0, description="constant, on positions of the feet, likewise [m]"
    )
    scene: float = Field(
        default=0.0,
        ge=0.0,
        description="constant, on positions of the scene that the policy is told [m]",
    )
    scene_angle: float = Field(
        default=0.0, ge=0.0, description="the same on its other numbers [rad, 1]"
    )
    estimate: float = Field(
        default=1.0,
        ge=0.0,
        description="on estimated numbers of the scene: this times their error on held-out views, "
        "and half of it white",
    )


class ViewsConfig(StrictModel):
    """How the encoder learns to estimate the scene: rendered views with a simulator's labels.

    A view is a frame of a training demonstration in which the torso was moved a little and, in a
    part of the views, the scene's joints are those of another frame. Standard deviations.
    """

    count: int = Field(default=3600, ge=100, description="number of views to learn from")
    held_out: int = Field(default=400, ge=20, description="views of held-out demonstrations")
    along: float = Field(default=0.02, ge=0.0, description="the torso forward [m]")
    across: float = Field(default=0.04, ge=0.0, description="the torso to the left [m]")
    up: float = Field(default=0.005, ge=0.0, description="the torso up [m]")
    yaw: float = Field(default=0.06, ge=0.0, description="the torso about z [rad]")
    tilt: float = Field(default=0.01, ge=0.0, description="the torso about x and y [rad]")
    other_scene: float = Field(
        default=0.3, ge=0.0, le=1.0, description="part of the views with another frame's joints"
    )
    steps: int = Field(default=600, ge=1, description="gradient steps")
    batch: int = Field(default=32, ge=2, description="views in a step")
    rate: float = Field(default=3e-3, gt=0.0, description="largest learning rate")
    landmarks: tuple[str, ...] = Field(
        default=(),
        description="objects of the scene that are in sight, tied to a key point each; none: those "
        "whose position is estimated",
    )
    heat: float = Field(
        default=0.1,
        ge=0.0,
        description="weight of a second loss: a key point for each landmark, a Gaussian around it",
    )
    brightness: float = Field(default=0.05, ge=0.0, description="of the pictures' jitter [1]")
    contrast: float = Field(default=0.1, ge=0.0, description="of the pictures' jitter [1]")


class GaitsConfig(StrictModel):
    """How a network of their own for the gaits learns, before the rest of the policy."""

    steps: int = Field(default=600, ge=1, description="gradient steps")
    batch: int = Field(default=256, ge=1, description="frames in a step")
    rate: float = Field(default=3e-3, gt=0.0, description="largest learning rate")
    weight_decay: float = Field(default=1e-4, ge=0.0, description="of AdamW")


class InterventionConfig(StrictModel):
    """What is learned from episodes in which an operator took over from a policy.

    By default the operator's frames count, like all other frames, and the policy's do not
    (HG-DAgger, Kelly et al. 2019).
    """

    share: float | None = Field(
        default=None,
        gt=0.0,
        lt=1.0,
        description="part of the windows that begin in an intervention, however few there are, for "
        "instance 0.5 (Mandlekar et al. 2020); null: as many as there are",
    )
    policy_frames: bool = Field(
        default=False, description="learn from what policies did in successful episodes, too"
    )


class TrainingConfig(StrictModel):
    """How a policy learns."""

    steps: int = Field(default=20_000, ge=1, description="gradient steps")
    minutes: float | None = Field(
        default=None,
        gt=0.0,
        description="stop after so long and fit the learning rate to that, in place of steps; what "
        "is learned then depends on the machine",
    )
    batch: int = Field(default=16, ge=1, description="windows in a step, over all processes")
    window: int = Field(default=10, ge=1, description="frames in a window")
    loss_frames: int = Field(
        default=0, ge=0, description="random frames of each window that count; 0: all"
    )
    active: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="part of the windows that is drawn around frames in which hands or grippers "
        "move and stand, however little of a demonstration these are; the rest from all frames",
    )
    standstill: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="part of the windows in which, from a random frame on, the robot seems to "
        "stand still: a policy that hesitated has to go on, too",
    )
    rate: float = Field(default=1e-4, gt=0.0, description="largest learning rate")
    schedule: Literal["constant", "one-cycle"] = Field(
        default="constant", description="of the learning rate"
    )
    weight_decay: float = Field(default=0.0, ge=0.0, description="of AdamW")
    clip: float = Field(default=0.0, ge=0.0, description="largest norm of the gradient; 0: none")
    average: float = Field(
        default=0.0,
        ge=0.0,
        lt=1.0,
        description="decay of the moving average of the weights, which is what is kept; 0: none",
    )
    shift: int = Field(
        default=0, ge=0, description="random shift of pictures, both eyes alike [pixels]"
    )
    noise: NoiseConfig = NoiseConfig()
    views: ViewsConfig = ViewsConfig()
    gaits: GaitsConfig = GaitsConfig()
    interventions: InterventionConfig = InterventionConfig()
    held_out: float = Field(
        default=0.1, gt=0.0, lt=1.0, description="part of the episodes that is not learned from"
    )
    validate_every: int = Field(default=500, ge=1, description="steps between two checkpoints")
    precision: Literal["auto", "float32", "bfloat16"] = Field(
        default="auto", description="auto: 16 bits where the processor multiplies them in hardware"
    )
    seed: int = Field(default=0, ge=0, description="of weights, windows and noise")
