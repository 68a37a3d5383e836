"""Messages of a robot and its operator with random content, for probe services and benchmarks."""

from collections.abc import Iterator
from itertools import count, cycle
from typing import Any, TypeVar

import numpy as np

from common.schemas import (
    CameraFrame,
    ControllerState,
    ControlState,
    EpisodeAction,
    EpisodeMark,
    Estop,
    Gait,
    GaitRequest,
    JointCommand,
    Message,
    PlantState,
    Setpoint,
)
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    EPISODE,
    ESTOP,
    PLANT_STATE,
    PLANT_TRUTH,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_COMMAND,
    WBC_STATE,
    Topic,
)
from common.wire.schema import array_spec

M = TypeVar("M", bound=Message)

ROBOT_RATES: dict[Topic[Any], float] = {
    PLANT_STATE: 200.0,
    PLANT_TRUTH: 50.0,
    WBC_COMMAND: 100.0,
    WBC_STATE: 100.0,
    CAMERA_LEFT: 20.0,
    CAMERA_RIGHT: 20.0,
    EPISODE: 2.0,
}
"""A robot's full traffic [Hz]."""
OPERATOR_RATES: dict[Topic[Any], float] = {TELEOP_SETPOINT: 20.0, TELEOP_GAIT: 5.0, ESTOP: 2.5}
"""An operator's traffic [Hz]."""
PICTURES = ("none", "jpeg", "raw")
JPEG_BYTES = 30_000
"""Size of a 400 × 300 picture of a textured scene at quality 85 [bytes]."""
WIDTH, HEIGHT = 400, 300


def random_message(schema: type[M], rng: np.random.Generator, **fields: object) -> M:
    """Return a message whose arrays are uniformly random, unit vectors where these are required.

    Args:
        schema: type of the message.
        rng: source of the numbers.
        fields: values of the fields that are not arrays.
    """
    arrays: dict[str, Any] = {}
    for name, field in schema.model_fields.items():
        spec = array_spec(field.metadata)
        if spec is not None:
            values = rng.uniform(size=spec.shape)
            arrays[name] = values / np.linalg.norm(values) if spec.unit else values
    return schema.model_validate({**arrays, **fields})


def message_streams(pictures: str, seed: int = 0) -> dict[Topic[Any], Iterator[Message]]:
    """Return endless messages for every topic of the two tables of rates.

    Args:
        pictures: ``jpeg`` (noise of a JPEG's size), ``raw`` (a smooth 8-bit RGB scene with sensor
            noise) or ``none``; they are as hard to compress as real pictures.
        seed: seed of the random content.
    """
    rng = np.random.default_rng(seed)
    controller = {
        "state": ControlState.BALANCE, "gait": Gait.NONE, "gait_progress": 0.0,
        "gaits_completed": 0, "dcm_error": 0.1, "hand_weight": 1.0, "setpoint_fresh": True,
        "solver": "osqp", "unsolved": 0,
    }  # fmt: skip
    streams: dict[Topic[Any], Iterator[Message]] = {
        PLANT_STATE: cycle([random_message(PlantState, rng) for _ in range(16)]),
        PLANT_TRUTH: cycle([random_message(PlantState, rng) for _ in range(16)]),
        WBC_COMMAND: cycle([random_message(JointCommand, rng) for _ in range(16)]),
        WBC_STATE: cycle([random_message(ControllerState, rng, **controller) for _ in range(16)]),
        TELEOP_SETPOINT: cycle([random_message(Setpoint, rng)]),
        TELEOP_GAIT: cycle([GaitRequest(request_id=1, gait=Gait.FORWARD)]),
        ESTOP: cycle([Estop(reason="fault experiment")]),
        EPISODE: (
            EpisodeMark(episode=number, action=action, label=f"trial {number}")
            for number in count()
            for action in (EpisodeAction.START, EpisodeAction.END)
        ),
    }
    if pictures != "none":
        frames = [_picture(rng, pictures) for _ in range(8)]
        streams[CAMERA_LEFT] = cycle(frames)
        streams[CAMERA_RIGHT] = cycle([f.model_copy(update={"eye": "right"}) for f in frames])
    return streams


def _picture(rng: np.random.Generator, kind: str) -> CameraFrame:
    if kind == "jpeg":
        return CameraFrame(
            eye="left", width=WIDTH, height=HEIGHT, encoding="jpeg", data=rng.bytes(JPEG_BYTES)
        )
    x, y = np.meshgrid(np.linspace(0, 9, WIDTH), np.linspace(0, 7, HEIGHT))
    scene = 110 + 60 * np.sin(x + rng.uniform()) * np.cos(y)
    noisy = scene[:, :, None] + rng.normal(scale=2.0, size=(HEIGHT, WIDTH, 3))
    data = noisy.astype(np.uint8).tobytes()
    return CameraFrame(eye="left", width=WIDTH, height=HEIGHT, encoding="rgb8", data=data)
