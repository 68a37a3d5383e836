"""Garbage on the topics of a standing robot is refused and counted; the robot keeps standing."""

import msgpack
import numpy as np
import pytest

from common.schemas import (
    Gait,
    GaitRequest,
    Header,
    JointCommand,
    Message,
    PlantState,
    Setpoint,
)
from common.topics import PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, WBC_COMMAND, Topic
from common.wire.codec import encode, schema_tag
from verification.walking.stack import FORWARD, Scenario, Stack

TARGETS: list[tuple[str, Topic[Message]]] = [
    ("sim", WBC_COMMAND),
    ("wbc", PLANT_STATE),
    ("wbc", TELEOP_SETPOINT),
    ("wbc", TELEOP_GAIT),
]


def good_payload(stack: Stack, topic: Topic[Message]) -> bytes:
    header = Header(seq=10_000, stamp=stack.plant.now_ns, boot=99, source="stranger")
    joints = np.zeros(27)
    hand = np.array([0.3, 0.2, 0.1])
    samples: dict[type[Message], Message] = {
        JointCommand: JointCommand(
            position=joints,
            velocity=joints,
            acceleration=joints,
            torque=joints,
            stiffness=joints,
            damping=joints,
            gripper_closure=np.zeros(2),
        ),
        PlantState: stack.plant.truth(),
        Setpoint: Setpoint(
            left_hand_position_in_body=hand,
            left_hand_quaternion_in_body=FORWARD,
            right_hand_position_in_body=hand * [1, -1, 1],
            right_hand_quaternion_in_body=FORWARD,
            gripper_closure=np.zeros(2),
        ),
        GaitRequest: GaitRequest(request_id=1, gait=Gait.FORWARD),
    }
    return encode(samples[topic.schema], header)


def garbage(stack: Stack, topic: Topic[Message], rng: np.random.Generator) -> list[bytes]:
    good = good_payload(stack, topic)
    fields = msgpack.unpackb(good)
    cut = good[: len(good) // 2]
    noise = rng.bytes(len(good))
    unknown = msgpack.packb({**fields, "surprise": 1})
    missing = msgpack.packb({k: v for k, v in fields.items() if k != sorted(fields)[0]})
    poisoned = {
        k: np.full(len(v) // 8, np.nan).tobytes() if isinstance(v, bytes) else v
        for k, v in fields.items()
    }
    if poisoned == fields:
        poisoned = {**fields, "gait": 77}
    return [b"", noise, cut, unknown, missing, msgpack.packb(poisoned), b"\x93" * 50]


@pytest.mark.parametrize(("service", "topic"), TARGETS, ids=lambda p: getattr(p, "name", p))
def test_garbage_is_refused_and_counted_and_the_robot_stands(
    service: str, topic: Topic[Message]
) -> None:
    stack = Stack(Scenario())
    stack.run_for(1.5)
    height = stack.plant.truth().base_position[2]
    rng = np.random.default_rng(5)
    sent = 0
    for _ in range(20):
        for payload in garbage(stack, topic, rng):
            stack.runner.inbox(service).offer(topic.name, payload, stack.runner.now_ns)
            sent += 1
        stack.run_for(0.05)
    status = stack.runner.inbox(service).health_of(topic)
    assert status.refused == sent
    assert "expected" in status.last_refusal or "payload" in status.last_refusal
    assert not stack.fallen
    assert stack.operator.completed == 0
    assert stack.plant.truth().base_position[2] == pytest.approx(height, abs=0.01)


def test_another_schema_is_refused_with_both_names() -> None:
    stack = Stack(Scenario())
    stack.run_for(1.2)
    inbox = stack.runner.inbox("sim")
    payload = good_payload(stack, PLANT_STATE)
    inbox.offer(WBC_COMMAND.name, payload, stack.runner.now_ns, schema_tag(PlantState))
    stack.run_for(0.05)
    refusal = inbox.health_of(WBC_COMMAND).last_refusal
    assert "PlantState" in refusal
    assert "JointCommand" in refusal
    assert "acceleration" in refusal
    assert not stack.fallen


def test_well_formed_but_absurd_commands_do_not_reach_the_motors() -> None:
    stack = Stack(Scenario())
    stack.run_for(1.5)
    for value in (1e4, -1e4):
        absurd = JointCommand(
            header=Header(stamp=stack.plant.now_ns),
            position=np.zeros(27),
            velocity=np.zeros(27),
            acceleration=np.zeros(27),
            torque=np.full(27, value),
            stiffness=np.zeros(27),
            damping=np.zeros(27),
            gripper_closure=np.zeros(2),
        )
        stack.runner.inject(WBC_COMMAND, absurd, source="stranger")
        stack.run_for(0.02)
    assert stack.plant.guard.refused >= 1
    stack.run_for(1.0)
    assert not stack.fallen
