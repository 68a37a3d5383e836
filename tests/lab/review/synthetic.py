"""Messages of a fake robot, for tests of summaries, pictures and the live table."""

from collections.abc import Iterator
from itertools import count
from math import cos, sin
from typing import Any

import numpy as np

from common.robot.frames import NOMINAL_HAND_IN_BODY
from common.robot.joints import NOMINAL_POSITION
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    GuardMode,
    Header,
    LinkHealth,
    Message,
    PlantState,
    PlantStatus,
    ServiceHealth,
    Setpoint,
    StepJournal,
)
from common.topics import (
    HEALTH,
    JOURNAL,
    PLANT_STATE,
    PLANT_STATUS,
    PLANT_TRUTH,
    TASK_SCENE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_REPLY,
    WBC_STATE,
    Topic,
)
from lab.review.scoring import FEET_AHEAD_OF_TORSO
from lab.review.timeline import Timeline
from services.wbc.config import GaitConfig, WbcConfig

Pair = tuple[Topic[Any], Message]
MS = 1_000_000


def beginning(timeline: Timeline, count: int, **events: Any) -> Timeline:
    """The first ground truths of a timeline, with their scene and such ``events`` as are given."""
    short = Timeline(**events)
    scenes = timeline.scene_states_at(range(count))
    for state, scene in zip(timeline.truth[:count], scenes, strict=True):
        if scene is not None:
            short.add(TASK_SCENE, scene)
        short.add(PLANT_TRUTH, state)
    return short


class FakeRobot:
    """Makes messages with growing sequence numbers; times in ms of robot and sender's clock."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], count[int]] = {}
        self.now = 1000

    def header(self, topic: Topic[Any], source: str, skip: int = 0, boot: int = 1) -> Header:
        counter = self._counts.setdefault((topic.name, source), count())
        for _ in range(skip):
            next(counter)
        return Header(
            seq=next(counter),
            stamp=self.now * MS,
            sent=self.now * MS + 500_000,
            boot=boot,
            source=source,
        )

    def plant(
        self, topic: Topic[Any], x: float, y: float, yaw: float, *, resets: int = 0, skip: int = 0
    ) -> Pair:
        """A plant state whose feet are centred on (x, y) with heading ``yaw``."""
        base = (x - FEET_AHEAD_OF_TORSO * cos(yaw), y - FEET_AHEAD_OF_TORSO * sin(yaw), 0.74)
        return topic, PlantState(
            header=self.header(topic, "sim", skip),
            base_position=np.array(base),
            base_quaternion=np.array([cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)]),
            base_linear_velocity=np.zeros(3),
            base_angular_velocity=np.zeros(3),
            joint_position=NOMINAL_POSITION,
            joint_velocity=np.zeros(27),
            joint_torque=np.zeros(27),
            gripper_closure=np.zeros(2),
            foot_normal_force=np.full(2, 187.0),
            reset_count=resets,
        )

    def status(self, *, fallen: bool = False, factor: float = 1.0, age: float = 0.004) -> Pair:
        return PLANT_STATUS, PlantStatus(
            header=self.header(PLANT_STATUS, "sim"),
            guard=GuardMode.DAMP if fallen else GuardMode.ACTIVE,
            paused=False,
            fallen=fallen,
            real_time_factor=factor,
            age_at_torque_median=age,
            age_at_torque_p99=2 * age,
            commands_applied=100,
            commands_refused=2,
            holds=1,
            saturated_fraction=0.25,
            late_steps=3,
        )

    def wbc(self, *, hand: tuple[float, float] = (0.001, 0.003), fresh: bool = True) -> Pair:
        return WBC_STATE, ControllerState(
            header=self.header(WBC_STATE, "wbc"),
            state=ControlState.BALANCE,
            gait=Gait.NONE,
            gait_progress=0.0,
            gaits_completed=0,
            dcm_error=0.002,
            com_in_world=np.zeros(3),
            hand_position_error=np.array(hand),
            hand_rotation_error=np.array([0.01, 0.02]),
            hand_weight=20.0,
            setpoint_fresh=fresh,
            solver="daqp",
            unsolved=0,
        )

    def ask(self, request_id: int, gait: Gait, boot: int = 1) -> Pair:
        return TELEOP_GAIT, GaitRequest(
            header=self.header(TELEOP_GAIT, "teleop", boot=boot), request_id=request_id, gait=gait
        )

    def answer(self, request_id: int, gait: Gait, outcome: GaitOutcome, why: str = "") -> Pair:
        return WBC_REPLY, GaitReply(
            header=self.header(WBC_REPLY, "wbc"),
            request_id=request_id,
            gait=gait,
            outcome=outcome,
            reason=why,
        )

    def setpoint(self, closure: float = 0.0) -> Pair:
        return TELEOP_SETPOINT, Setpoint(
            header=self.header(TELEOP_SETPOINT, "teleop"),
            left_hand_position_in_body=np.array(NOMINAL_HAND_IN_BODY["left"]),
            left_hand_quaternion_in_body=np.array([1.0, 0.0, 0.0, 0.0]),
            right_hand_position_in_body=np.array(NOMINAL_HAND_IN_BODY["right"]),
            right_hand_quaternion_in_body=np.array([1.0, 0.0, 0.0, 0.0]),
            gripper_closure=np.full(2, closure),
        )

    def health(self, service: str, *, misses: int, median: float, p99: float) -> Pair:
        link = LinkHealth(topic="plant/state", received=10, rate=100.0, age=0.01, gaps=2, refused=1)
        return HEALTH, ServiceHealth(
            header=self.header(HEALTH, service),
            service=service,
            pid=1,
            period=0.01,
            steps=1000,
            deadline_misses=misses,
            step_median=median,
            step_p99=p99,
            cpu=0.3,
            realtime="normal",
            links=[link],
        )

    def settings(self, gait: GaitConfig) -> Pair:
        """The first journal of a controller with these gaits."""
        return JOURNAL, StepJournal(
            header=self.header(JOURNAL, "wbc"),
            service="wbc",
            first_step=0,
            sources=[],
            steps=b"",
            inputs=b"",
            settings=WbcConfig(gait=gait).model_dump_json(),
        )

    def gait(
        self, request_id: int, gait: Gait, start: tuple[float, float, float], end: Any
    ) -> Iterator[Pair]:
        """One accepted and completed gait of 3 s between two poses (x, y, yaw)."""
        yield self.ask(request_id, gait)
        yield self.plant(PLANT_TRUTH, *start)
        yield self.answer(request_id, gait, GaitOutcome.ACCEPTED)
        for step in range(1, 31):
            self.now += 100
            share = step / 30
            pose = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
            yield self.plant(PLANT_TRUTH, *pose)
            yield self.plant(PLANT_STATE, *pose)
            yield self.wbc()
            yield self.setpoint(closure=1.0 if 10 < step < 20 else 0.0)
            yield self.status()
        yield self.answer(request_id, gait, GaitOutcome.COMPLETED)
