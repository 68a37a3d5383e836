"""Who gets the robot, and what its hands do, in a thousand random histories."""

from dataclasses import dataclass, field

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.robot.rotations import matrix_from_rotation_vector, rotation_vector_from_matrix
from common.schemas import Sender
from services.wbc.authority import Authority
from services.wbc.handover import HandOver, Target

from .operators import (
    CONFIG,
    LISTENED,
    PERSON,
    POLICY,
    SCRIPT,
    TICK,
    Operator,
    Table,
    acts,
)
from .support import Array

WHO = (
    (PERSON, "keyboard"), (PERSON, "headset"), (SCRIPT, "teleop"), (POLICY, "policy"),
    (POLICY, "other"),
)  # fmt: skip
EVENTS = (
    "act", "act", "act", "release", "want", "silent", "heard", "restart", "lie", "believe",
    "stop", "clear", "new controller", "wait", "wait",
)  # fmt: skip
SPEED = 0.2
"""Of every operator's own hands [m/s]."""
PEAK = 1.875
"""Largest speed of a minimum-jerk motion over its mean."""


@dataclass
class Hands:
    """What one operator sends: hands that circle slowly somewhere in reach."""

    centre: Array
    turned: Array

    def at(self, time: float) -> Target:
        angle = SPEED / 0.1 * time
        away = 0.1 * np.array([0.0, np.cos(angle), np.sin(angle)])
        rotation = matrix_from_rotation_vector(self.turned)
        return Target(
            np.array([self.centre + away, self.centre - away]),
            np.array([rotation, rotation.T]),
            np.array([0.2, 0.9]),
            0.1,
        )


@dataclass
class History:
    """A controller and five operators to which things happen, checked after each update."""

    table: Table = field(default_factory=lambda: Table(now=LISTENED))
    present: Target | None = None
    moved: float = 0.0
    boots: int = 100

    def __post_init__(self) -> None:
        rng = np.random.default_rng(1)
        self.table.operators = [
            Operator(Sender(name, n + 1), kind, act=kind is SCRIPT, wants=kind is not PERSON)
            for n, (kind, name) in enumerate(WHO)
        ]
        self.hands = [Hands(rng.uniform(-0.3, 0.3, 3), rng.normal(size=3)) for _ in WHO]
        self.hand_over = HandOver(CONFIG)
        self.began = self.table.now

    def happen(self, event: str, number: int) -> None:
        one, table = self.table.operators[number], self.table
        match event:
            case "act" if one.kind is not POLICY:
                acts(one)
            case "release" | "want":
                one.wants = event == "want"
            case "silent" | "heard":
                one.silent = event == "silent"
            case "restart":
                self.boots += 1
                again = Operator(
                    Sender(one.sender.source, self.boots), one.kind, one.wants, one.act
                )
                table.operators[number] = again
            case "lie" | "believe":
                one.holding = event == "lie" or table.authority.holder == one.sender
            case "stop" | "clear":
                table.stopped = event == "stop"
            case "new controller":
                table.authority, self.hand_over = Authority(CONFIG), HandOver(CONFIG)
                self.began = table.now
        # The robot's time and everybody's set-points go on.
        before = {one.sender: one.act for one in table.operators}
        for ticks in range(1 + 12 * (event == "wait")):
            self.check(acted=one if event == "act" and not ticks else None)
        assert before == {one.sender: one.act for one in table.operators}

    def check(self, acted: Operator | None) -> None:
        table = self.table
        holder = table.authority.holder
        kind = table.authority.state.kind
        changes = table.update()
        for change in changes:
            if holder is not None and change.holder and kind is PERSON:
                assert change.kind is PERSON, "taken from a person by a machine"
            if holder is not None:
                assert (change.previous, change.previous_boot) == holder
            holder = Sender(change.holder, change.holder_boot) if change.holder else None
            kind = change.kind
        assert holder == table.authority.holder
        assert not (table.stopped and holder), "somebody has a robot that is stopped"
        listening = table.now - self.began <= 10**9 + TICK
        if acted and acted.kind is PERSON and not (acted.silent or table.stopped or listening):
            assert holder == acted.sender, "a person's act does not get the robot"
        if changes:
            self.hand_over.begin()
        if holder is not None:
            self.follow(holder)

    def follow(self, holder: Sender) -> None:
        """The holder's set-point arrives; the target may move but not jump."""
        time = self.table.now * 1e-9
        number = next(n for n, (_, name) in enumerate(WHO) if name == holder.source)
        target = self.hands[number].at(time)
        present = target if self.present is None else self.present
        now = self.hand_over.apply(target, present, time)
        elapsed = time - self.moved
        if self.present is not None:
            step = np.linalg.norm(now.positions - present.positions, axis=1).max()
            assert step <= elapsed * (PEAK * CONFIG.blend_speed + SPEED) + 1e-9, "a jump"
            for one, other in zip(now.rotations, present.rotations, strict=True):
                angle = np.linalg.norm(rotation_vector_from_matrix(one @ other.T))
                assert angle <= elapsed * PEAK * CONFIG.blend_turn_rate + 1e-6, "a turn"
            grip = np.abs(now.grippers - present.grippers).max()
            assert grip <= elapsed * PEAK / CONFIG.blend_time + 1e-9
        self.present, self.moved = now, time


@settings(max_examples=1000, derandomize=True, deadline=None, database=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(EVENTS), st.integers(0, len(WHO) - 1)), min_size=5, max_size=25
    )
)
def test_in_no_history_do_two_have_the_robot_or_does_it_jump(events: list[tuple[str, int]]) -> None:
    history = History()
    for event, number in events:
        history.happen(event, number)
