"""Configuration of the service that runs a policy."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from services.policy.configuration import ChunkConfig, PolicySettings, StrictModel

RuntimeName = Literal["torch", "onnx", "openvino"]
"""What computes a network: torch, ONNX Runtime or OpenVINO."""
Precision = Literal["float32", "bfloat16"]
WINDOW = 20
"""Frames that a recurrent policy of chunks sees anew for each, unless configured."""


class TriggerConfig(StrictModel):
    """When the probability of a gait becomes a request for it."""

    rule: Literal["hazard", "threshold"] = Field(
        default="hazard",
        description="hazard: the probability accumulates over the frames in balance, in units of "
        "the frames before a request that were trained as one; threshold: that of one frame counts",
    )
    level: float = Field(default=0.7, gt=0.0, description="at which a gait is requested")
    hold_off: float = Field(
        default=0.5, ge=0.0, description="after the end of a gait no other is requested for [s]"
    )
    patience: float = Field(
        default=2.0,
        gt=0.0,
        description="time in balance after which a request without an answer is taken for lost [s]",
    )


class PolicyConfig(StrictModel):
    """Configuration of a policy that operates the robot."""

    checkpoint: Path = Field(description="folder of the checkpoint")
    kind: str | None = Field(
        default=None, description="of the policy that is wanted; null: any, as the checkpoint says"
    )
    remote: bool = Field(
        default=False,
        description="an inference server computes; the robot's side needs no torch, and of the "
        "checkpoint config.json and processor.json alone",
    )
    runtime: RuntimeName = Field(
        default="torch",
        description="computes in this process, unless remote; onnx and openvino need no torch, but "
        "a network that trill export-policy has exported",
    )
    device: str = Field(default="cpu", description="of the runtime, for instance cuda")
    threads: int = Field(default=1, ge=1, description="of the runtime; one beside a simulator")
    precision: Precision = Field(
        default="float32", description="in which openvino looks at pictures"
    )
    execute: int | None = Field(
        default=None,
        ge=1,
        description="steps of a chunk that are carried out before the next one; null: as the "
        "checkpoint says",
    )
    window: int | None = Field(
        default=None,
        ge=0,
        le=128,
        description="frames that a recurrent policy sees anew for each answer, from an empty "
        "memory, as in training; 0: the memory goes on from the start. null: 20 for a policy of "
        "chunks, 0 for any other",
    )
    inference_steps: int | None = Field(
        default=None,
        ge=0,
        le=15,
        description="steps of 50 ms from a request to the use of its answer, where the network "
        "runs in the policy's own process. 0: the set-point of the step waits for the network; 1: "
        "the network runs after that has been sent, so that set-points come steadily however long "
        "it takes; more: in simulated time, in which computing takes none, what a slow processor "
        "would do. null: 1 for a policy of chunks, 0 for any other",
    )
    compensate: bool = Field(
        default=True,
        description="skip as many steps of a chunk as the measured delay takes; a policy of "
        "differences cannot",
    )
    trigger: TriggerConfig = TriggerConfig()
    late_after: float = Field(
        default=0.3, gt=0.0, description="age of pictures or an answer that counts as late [s]"
    )
    stale_after: float = Field(
        default=1.0, gt=0.0, description="age of pictures above which nothing is planned [s]"
    )
    hold_after: float = Field(
        default=0.25, gt=0.0, description="time without a new set-point that counts as starved [s]"
    )
    answer_timeout: float = Field(
        default=1.0, gt=0.0, description="time after which a request is given up and made anew [s]"
    )
    start_timeout: float = Field(
        default=60.0, gt=0.0, description="timeout until BALANCE is seen and it has the robot [s]"
    )
    stay: bool = Field(default=False, description="wait for the robot without a timeout")

    @model_validator(mode="after")
    def _precision_of_the_runtime(self) -> Self:
        if self.precision != "float32" and self.runtime != "openvino":
            raise ValueError(
                f"expected precision float32 of the runtime {self.runtime}, got {self.precision}; "
                "the runtime openvino computes in it"
            )
        return self

    @model_validator(mode="after")
    def _ages_rise(self) -> Self:
        if self.stale_after < self.late_after:
            raise ValueError(
                f"expected stale_after of at least late_after, {self.late_after:g} s, got "
                f"{self.stale_after:g} s"
            )
        return self

    def steps_of(self, policy: PolicySettings) -> int:
        """Return how many steps of an answer of ``policy`` are carried out before the next one."""
        wanted = policy.actions.execute if isinstance(policy.actions, ChunkConfig) else 1
        return min(self.execute or wanted, policy.actions.shape[0])

    def inference_steps_of(self, policy: PolicySettings) -> int:
        """Return the steps from a request of ``policy`` to the use of its answer."""
        if self.inference_steps is not None:
            return self.inference_steps
        return 1 if isinstance(policy.actions, ChunkConfig) else 0

    def window_of(self, policy: PolicySettings) -> int:
        """Return the frames that ``policy`` sees anew for each answer; 0: its memory goes on."""
        if policy.recurrence is None:
            return 1
        if self.window is not None:
            return self.window
        return WINDOW if isinstance(policy.actions, ChunkConfig) else 0
