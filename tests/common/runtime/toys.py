"""Toy services for the runtime tests; as a script, one of them runs live."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from common.runtime.live.main import run_live
from common.runtime.service import Inputs, Output, Service
from common.schemas import CameraFrame, Gait, GaitRequest, Header, JointCommand, PlantState
from common.topics import CAMERA_LEFT, PLANT_STATE, TELEOP_GAIT, WBC_COMMAND, Topic


def plant_state(value: float, stamp: int = 0) -> PlantState:
    return PlantState(
        header=Header(stamp=stamp),
        base_position=np.full(3, value),
        base_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        base_linear_velocity=np.zeros(3),
        base_angular_velocity=np.zeros(3),
        joint_position=np.full(27, value),
        joint_velocity=np.zeros(27),
        joint_torque=np.zeros(27),
        gripper_closure=np.zeros(2),
        foot_normal_force=np.zeros(2),
    )


def joint_command(value: float, stamp: int = 0) -> JointCommand:
    return JointCommand(
        header=Header(stamp=stamp),
        position=np.full(27, value),
        velocity=np.zeros(27),
        acceleration=np.zeros(27),
        torque=np.zeros(27),
        stiffness=np.zeros(27),
        damping=np.zeros(27),
        gripper_closure=np.zeros(2),
    )


class ToyPlant(Service):
    """An integrator: joint position moves by 1 % of the way to the command each millisecond."""

    name = "sim"
    reads: tuple[Topic[Any], ...] = (WBC_COMMAND,)
    writes: tuple[Topic[Any], ...] = (PLANT_STATE,)

    def __init__(self, period_ns: int = 1_000_000, every: int = 5) -> None:
        self.period_ns = period_ns
        self.every = every
        self.value = 0.0
        self.steps = 0
        self.seen: list[tuple[int, int, int]] = []
        self.closed = False

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        self.steps += 1
        command = inputs.latest(WBC_COMMAND)
        if command is not None and inputs.fresh(WBC_COMMAND):
            self.value += 0.01 * (command.position[0] - self.value)
        if command is not None and inputs.updated(WBC_COMMAND):
            self.seen.append((now_ns, command.header.sent, command.header.injected))
        if self.steps % self.every == 0:
            return [Output(PLANT_STATE, plant_state(self.value, now_ns))]
        return []

    def close(self) -> None:
        self.closed = True
        print("the toy plant is closed", file=sys.stderr)


class ToyController(Service):
    """Commands one more than the state it sees."""

    name = "wbc"
    period_ns = 10_000_000
    reads: tuple[Topic[Any], ...] = (PLANT_STATE, TELEOP_GAIT)
    writes: tuple[Topic[Any], ...] = (WBC_COMMAND,)

    def __init__(self, trigger: bool = False) -> None:
        self.trigger = PLANT_STATE if trigger else None
        self.seen: list[tuple[int, int, int]] = []
        self.gaits: list[GaitRequest] = []

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        self.gaits += inputs.events(TELEOP_GAIT)
        state = inputs.latest(PLANT_STATE)
        if state is None:
            return []
        if inputs.updated(PLANT_STATE):
            self.seen.append((now_ns, state.header.sent, state.header.injected))
        return [
            Output(WBC_COMMAND, joint_command(state.joint_position[0] + 1.0, state.header.stamp))
        ]


class Failing(ToyPlant):
    """Fails in its third step."""

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        if self.steps == 2:
            raise RuntimeError("broken on purpose")
        return super().step(inputs, now_ns)


class FilmingPlant(ToyPlant):
    """Publishes 14 MB/s of pictures beside its state."""

    writes = (PLANT_STATE, CAMERA_LEFT)
    picture = CameraFrame(
        eye="left", width=640, height=360, encoding="rgb8", data=bytes(640 * 360 * 3)
    )

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        outputs = list(super().step(inputs, now_ns))
        if self.steps % 10 == 0:
            outputs.append(Output(CAMERA_LEFT, self.picture))
        return outputs


class WatchingController(ToyController):
    """Reads the pictures too."""

    reads = (PLANT_STATE, TELEOP_GAIT, CAMERA_LEFT)


def gait_request(number: int) -> GaitRequest:
    return GaitRequest(request_id=number, gait=Gait.FORWARD)


def build(arguments: argparse.Namespace) -> Service:
    if arguments.kind == "plant":
        return ToyPlant(period_ns=5_000_000, every=1)
    if arguments.kind == "filming":
        return FilmingPlant(period_ns=5_000_000, every=1)
    if arguments.kind == "watching":
        return WatchingController(trigger=True)
    if arguments.kind == "failing":
        return Failing(period_ns=5_000_000, every=1)
    if arguments.kind == "undeclared":
        plant = ToyPlant(period_ns=5_000_000, every=1)
        plant.writes = ()
        return plant
    return ToyController(trigger=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--kind", default="plant")


if __name__ == "__main__":
    service = os.environ["TOY_NAME"]
    raise SystemExit(run_live(build, service, add_arguments=add_arguments))
