"""Example messages of every topic and a free range of ports."""

import socket
from typing import TypeVar

import numpy as np

from common import schemas
from common.schemas import Gait, GuardMode, Header, LinkHealth, Message
from common.schemas.operator import OperatorStatus

M = TypeVar("M", bound=Message)

VECTOR = np.array([0.1, -0.2, 0.3])
QUATERNION = np.array([0.5, 0.5, -0.5, 0.5])
JOINTS = np.linspace(-1.0, 1.0, 27)
PAIR = np.array([0.25, 0.75])

HEADER = Header(seq=7, stamp=1_000_000_007, sent=2_000_000_001, boot=2**62, source="sim")


def plant_state(seq: int = 0, boot: int = 1, source: str = "sim") -> schemas.PlantState:
    return schemas.PlantState(
        header=Header(seq=seq, boot=boot, source=source),
        base_position=VECTOR,
        base_quaternion=QUATERNION,
        base_linear_velocity=2 * VECTOR,
        base_angular_velocity=3 * VECTOR,
        joint_position=JOINTS,
        joint_velocity=2 * JOINTS,
        joint_torque=3 * JOINTS,
        gripper_closure=PAIR,
        foot_normal_force=100 * PAIR,
        reset_count=2,
        guard=GuardMode.HOLD,
        fallen=True,
        controller_boot=2**61,
        torque_mode="rated",
    )


def health(source: str = "sim") -> schemas.ServiceHealth:
    link = LinkHealth(
        topic="plant/state",
        received=3,
        rate=2.5,
        age=-1.0,
        gaps=1,
        late=2,
        repeated=6,
        skipped=3,
        stale=4,
        adapted=7,
        foreign=8,
        refused=2,
        link="250ms",
        requested_mean=0.25,
        requested_p99=0.26,
        achieved_mean=0.27,
        achieved_p99=0.28,
        lost=5,
        stages=[schemas.StageTime(stage="wire", median=1e-3, p99=2e-3)],
    )
    return schemas.ServiceHealth(
        service=source,
        pid=123,
        period=0.01,
        steps=5,
        deadline_misses=1,
        step_median=1e-4,
        step_p99=2e-4,
        cpu=0.5,
        realtime="normal",
        links=[link, link.model_copy(update={"topic": "estop", "last_refusal": "not good"})],
        outputs=[schemas.OutputHealth(topic="wbc/command", sent=4, errors=1)],
        peers=[
            schemas.PeerHealth(
                source="wbc",
                alive=True,
                silent=0.02,
                losses=1,
                clock_offset=-0.2,
                clock_error=1e-4,
            )
        ],
        conflict="another sim",
    )


def device_input() -> schemas.DeviceInput:
    hand = schemas.HandController(
        position=VECTOR,
        quaternion=QUATERNION,
        tracked=True,
        trigger=0.5,
        squeeze=0.75,
        lower=True,
        upper=True,
        stick=PAIR,
        stick_pressed=True,
    )
    return schemas.DeviceInput(
        device="synthetic",
        head_position=VECTOR,
        head_quaternion=QUATERNION,
        head_tracked=True,
        left=hand,
        right=hand.model_copy(update={"position": -VECTOR}),
    )


def examples() -> list[Message]:
    """One message of every schema on the bus, none of whose fields has its default."""
    return [
        plant_state(),
        schemas.PlantStatus(
            guard=GuardMode.HOLD,
            paused=True,
            fallen=False,
            real_time_factor=0.9,
            age_at_torque_median=0.004,
            age_at_torque_p99=0.009,
            commands_applied=2**40,
            commands_refused=3,
            holds=1,
            saturated_fraction=0.25,
            late_steps=9,
            controller="wbc",
            controller_boot=2**61,
            commands_foreign=7,
            last_refusal="too old",
            stops=2,
            stopped_by="keyboard",
            stop_reason="smoke",
            divergences=1,
        ),
        schemas.PlantRequest(
            action=schemas.PlantAction.PUSH, force=100 * VECTOR, duration=0.2, seed=5
        ),
        schemas.Estop(reason="größer ⚠", pressed=False),
        schemas.EstopClear(reason="checked", stops=3),
        schemas.OperatorClaim(kind=schemas.OperatorKind.PERSON, wants=True, act=4, holding=True),
        schemas.AuthorityState(
            holder="keyboard",
            holder_boot=2**61,
            kind=schemas.OperatorKind.PERSON,
            changes=3,
            change=schemas.AuthorityChange.TAKEN,
            previous="teleop",
            previous_boot=2**60,
            since=1_500_000_000,
            waiting=["teleop", "policy"],
            ignored=8,
        ),
        schemas.JointCommand(
            position=JOINTS,
            velocity=JOINTS + 1,
            acceleration=JOINTS + 2,
            torque=JOINTS + 3,
            stiffness=JOINTS + 4,
            damping=JOINTS + 5,
            gripper_closure=PAIR,
        ),
        schemas.ControllerState(
            state=schemas.ControlState.LF_SWING,
            gait=Gait.TURN_LEFT,
            gait_progress=0.5,
            gaits_completed=4,
            dcm_error=0.01,
            com_in_world=VECTOR,
            hand_position_error=PAIR,
            hand_rotation_error=2 * PAIR,
            hand_weight=0.7,
            setpoint_fresh=True,
            solver="proxqp",
            unsolved=1,
            setpoint_stamp=1_250_000_000,
            obstacle="another controller has the plant",
        ),
        schemas.GaitReply(
            request_id=5,
            gait=Gait.FORWARD,
            outcome=schemas.GaitOutcome.REFUSED,
            reason="walking",
            requester_boot=2**59,
        ),
        schemas.Setpoint(
            left_hand_position_in_body=VECTOR,
            left_hand_quaternion_in_body=QUATERNION,
            right_hand_position_in_body=-VECTOR,
            right_hand_quaternion_in_body=-QUATERNION,
            gripper_closure=PAIR,
            neck_pitch=0.3,
        ),
        schemas.GaitRequest(request_id=9, gait=Gait.SIDE_RIGHT, controller_boot=2**58),
        device_input(),
        OperatorStatus(script="walk", step=3, steps=8, label="door", finished=True, failed="fell"),
        schemas.PolicyState(
            policy="trill",
            checkpoint="ab12",
            mode=schemas.PolicyMode.DEGRADED,
            label="no fresh picture",
            state_age=0.01,
            picture_age=0.02,
            delay=0.26,
            compensated=5,
            round_trip=0.03,
            inference=0.004,
            answers=9,
            late=1,
            unasked=2,
            refused=3,
            unanswered=4,
            gaits=5,
        ),
        schemas.CameraFrame(eye="right", width=4, height=2, encoding="rgb8", data=bytes(range(24))),
        health(),
        schemas.Heartbeat(steps=12, timeout=0.1, uptime=3.5),
        schemas.StepJournal(
            service="wbc",
            first_step=7,
            sources=[
                schemas.InputSource(
                    topic="plant/state", source="sim", boot=2**40, schema_tag="trill/X/1;ab"
                )
            ],
            steps=bytes(16),
            inputs=bytes(96),
            payloads=b"abc",
            settings='{"rate": 100.0}',
            lost=2,
        ),
        schemas.LinkChange(
            service="wbc", topic="teleop/setpoint", link="250ms", previous="20ms", reason="request"
        ),
        schemas.EpisodeMark(episode=3, action=schemas.EpisodeAction.END, label="door"),
        schemas.TaskStatus(
            task="door/unlock",
            seed=7,
            time=3.5,
            limit=20.0,
            verdict=schemas.TaskVerdict.PARTIAL,
            reason="the goal, but left wrist on jamb",
            stages=[schemas.TaskStage(name="lever pressed", done=True)],
            undesired=[schemas.UndesiredContact(name="left wrist on jamb", since=2.5, peak=44.0)],
            reset_count=2,
        ),
        schemas.SceneState(
            scene="door",
            task="door/unlock",
            objects=[schemas.ScenePose(name="lever", position=VECTOR, quaternion=QUATERNION)],
            joints=[schemas.SceneJoint(name="door_hinge", position=0.1)],
            marks=[schemas.ScenePose(name="goal", position=-VECTOR, quaternion=QUATERNION)],
            qpos=[0.1, 0.2],
            reset_count=2,
        ),
    ]


def example_of(schema: type[M]) -> M:
    """The first example of a schema."""
    return next(message for message in examples() if isinstance(message, schema))


def free_base_port(count: int = 10) -> int:
    """Return a port from which ``count`` ports on loopback are free right now."""
    while True:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            base = int(probe.getsockname()[1])
        if base + count < 65_000 and all(_free(base + offset) for offset in range(count)):
            return base


def _free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
