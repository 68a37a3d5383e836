"""Who gets the robot: rule by rule, and in a thousand random histories."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from common.robot.rotations import matrix_from_rotation_vector, rotation_vector_from_matrix
from common.schemas import AuthorityChange as Change
from common.schemas import AuthorityState, OperatorClaim, OperatorKind, Sender
from services.wbc.authority import Authority
from services.wbc.config import AuthorityConfig
from services.wbc.handover import HandOver, Target

from .support import Array, claim

PERSON, SCRIPT, POLICY = OperatorKind.PERSON, OperatorKind.SCRIPT, OperatorKind.POLICY
CONFIG = AuthorityConfig()
TICK = 50_000_000
LISTENED = 2 * 10**9
"""Robot time at which a new controller has listened long enough [ns]."""


@dataclass
class Operator:
    """An operator under the test's control; it is heard in every update until it is silent."""

    sender: Sender
    kind: OperatorKind
    wants: bool = True
    act: int = 0
    holding: bool = False
    silent: bool = False
    seq: int = -1

    def says(self) -> OperatorClaim:
        self.seq += not self.silent
        return claim(
            max(self.seq, 0),
            self.sender,
            self.kind,
            wants=self.wants,
            act=self.act,
            holding=self.holding,
        )


class Table:
    """Operators and a controller that they claim the robot from."""

    def __init__(
        self, *operators: Operator, now: int = 0, config: AuthorityConfig = CONFIG
    ) -> None:
        self.operators = list(operators)
        self.authority = Authority(config)
        self.now = now
        self.stopped = False

    def update(self, ticks: int = 1) -> list[AuthorityState]:
        changes = []
        for _ in range(ticks):
            self.now += TICK
            heard = [one for one in self.operators if one.seq >= 0 or not one.silent]
            claims = {one.sender: one.says() for one in heard}
            changes += self.authority.update(self.now, claims, stopped=self.stopped)
        return changes

    def settle(self) -> "Table":
        """Until the controller has listened long enough."""
        self.update(21)
        return self

    @property
    def holder(self) -> str:
        return "" if self.authority.holder is None else self.authority.holder.source


def person(name: str = "keyboard", boot: int = 1, act: int = 0) -> Operator:
    return Operator(Sender(name, boot), PERSON, wants=act > 0, act=act)


def script(name: str = "teleop", boot: int = 2) -> Operator:
    return Operator(Sender(name, boot), SCRIPT, act=1)


def policy(name: str = "policy", boot: int = 3) -> Operator:
    return Operator(Sender(name, boot), POLICY)


def acts(operator: Operator) -> None:
    operator.wants, operator.act = True, operator.act + 1


def _kinds(changes: Sequence[AuthorityState]) -> list[tuple[Change, str]]:
    return [(change.change, change.holder) for change in changes]


def test_a_new_controller_listens_for_one_lease_and_then_gives_the_robot_to_the_highest() -> None:
    table = Table(policy(), script())
    assert table.update(20) == []
    (change,) = table.update()
    assert _kinds([change]) == [(Change.GRANTED, "teleop")]
    assert (change.kind, change.holder_boot, change.changes) == (SCRIPT, 2, 1)
    assert (change.since, change.header.stamp) == (table.now, table.now)
    assert change.waiting == ["policy"]
    assert change.previous == ""


def test_who_asked_first_goes_first_among_equals() -> None:
    late, early = policy("late", 1), policy("early", 2)
    late.wants = False
    table = Table(late, early)
    table.update(2)
    late.wants = True
    table.settle()
    assert table.holder == "early"


def test_the_robot_goes_to_who_waits_when_it_is_given_back() -> None:
    someone, machine = person(act=1), policy()
    table = Table(someone, machine).settle()
    assert table.holder == "keyboard"
    someone.wants = False
    assert _kinds(table.update()) == [(Change.RELEASED, ""), (Change.GRANTED, "policy")]
    assert table.authority.state.previous == "keyboard"


@pytest.mark.parametrize(
    "first", [person(act=1), script(), policy()], ids=["person", "script", "policy"]
)
def test_a_person_s_act_gets_the_robot_from_anybody(first: Operator) -> None:
    first = Operator(Sender("first", 9), first.kind, act=first.act)
    other = person("other", 8)
    table = Table(first, other).settle()
    assert table.holder == "first"
    acts(other)
    assert _kinds(table.update()) == [(Change.TAKEN, "other")]
    # And it does not go to and fro, though the first goes on to want it.
    assert table.update(40) == []


@pytest.mark.parametrize(
    ("holder", "other"), [(script(), script("second", 7)), (person(act=1), script())]
)
def test_a_script_s_act_takes_from_nobody_of_its_rank_or_above(
    holder: Operator, other: Operator
) -> None:
    holder = Operator(holder.sender, holder.kind, act=1)
    table = Table(holder).settle()
    table.operators.append(Operator(other.sender, SCRIPT, act=1))
    table.update()
    acts(table.operators[1])
    table.update(40)
    assert table.holder == holder.sender.source


def test_the_first_claim_of_a_started_script_is_an_act() -> None:
    table = Table(policy()).settle()
    table.operators.append(script())
    assert _kinds(table.update()) == [(Change.TAKEN, "teleop")]


def test_policies_never_act() -> None:
    table = Table(policy()).settle()
    table.operators.append(Operator(Sender("other", 5), POLICY, act=1))
    table.update(3)
    acts(table.operators[1])
    table.update(3)
    assert table.holder == "policy"
    table.stopped = True
    table.update()
    table.stopped = False
    acts(table.operators[1])
    assert table.update(3) == []


def test_an_act_counts_once() -> None:
    """Claims come less often than updates."""
    one, other = person("one", 1), person("other", 2)
    table = Table(one, other).settle()
    acts(one)
    acts(other)
    assert _kinds(table.update()) == [(Change.GRANTED, "one"), (Change.TAKEN, "other")]
    one.silent = other.silent = True
    assert table.update(10) == []


def test_the_order_of_the_kinds_can_be_configured() -> None:
    config = AuthorityConfig(ranks=("policy", "script", "person"))
    table = Table(script(), policy(), config=config).settle()
    assert table.holder == "policy"
    with pytest.raises(ValidationError, match="once"):
        AuthorityConfig(ranks=("person", "person", "policy"))


def test_a_silent_script_or_policy_makes_room_for_whoever_waits() -> None:
    one, other = script(), policy()
    table = Table(one, other).settle()
    one.silent = True
    assert table.update(20) == []
    assert _kinds(table.update()) == [(Change.EXPIRED, ""), (Change.GRANTED, "policy")]


def test_nobody_follows_by_itself_on_a_person_who_fell_silent() -> None:
    someone, machine = person(act=1), policy()
    table = Table(someone, machine, script()).settle()
    someone.silent = True
    assert _kinds(table.update(60)) == [(Change.EXPIRED, "")]
    assert table.authority.state.waiting == ["policy", "teleop"]
    # It comes back, for the link was cut and not the person's wish.
    someone.silent = False
    assert _kinds(table.update()) == [(Change.GRANTED, "keyboard")]


def test_a_restarted_operator_of_a_silent_person_gets_the_robot_back() -> None:
    someone = person(act=1)
    table = Table(someone, policy()).settle()
    someone.silent = True
    table.update(40)
    again = Operator(Sender("keyboard", 77), PERSON, wants=False)
    table.operators.append(again)
    assert table.update(3) == []
    again.wants = True
    assert _kinds(table.update()) == [(Change.GRANTED, "keyboard")]


def test_another_person_who_waits_follows_on_one_who_fell_silent() -> None:
    first, second = person("first", 1, act=1), person("second", 2)
    table = Table(first, second).settle()
    second.wants = True
    table.update(2)
    assert table.holder == "first"
    first.silent = True
    assert table.update(21)[-1].holder == "second"


def test_a_new_act_follows_on_a_person_who_fell_silent() -> None:
    someone, machine = person(act=1), script()
    table = Table(someone, machine).settle()
    someone.silent = True
    table.update(40)
    acts(machine)
    assert _kinds(table.update()) == [(Change.GRANTED, "teleop")]


def test_an_operator_that_the_inbox_forgot_is_silent() -> None:
    machine = policy()
    table = Table(machine).settle()
    table.operators.clear()
    assert _kinds(table.update()) == [(Change.EXPIRED, "")]


def test_an_emergency_stop_takes_the_robot_and_only_a_later_act_gets_it() -> None:
    someone, machine, program = person(act=1), policy(), script()
    table = Table(someone, machine, program).settle()
    table.stopped = True
    assert _kinds(table.update()) == [(Change.STOPPED, "")]
    acts(someone)  # too early
    table.update(5)
    table.stopped = False
    assert table.update(60) == []
    acts(program)
    assert _kinds(table.update()) == [(Change.GRANTED, "teleop")]
    # What waits may have it again once it is given back.
    program.wants = False
    someone.wants = False
    assert _kinds(table.update()) == [(Change.RELEASED, ""), (Change.GRANTED, "policy")]


def test_a_controller_restarted_in_an_emergency_stop_gives_the_robot_to_no_believer() -> None:
    machine = script()
    machine.holding = True
    table = Table(machine)
    table.stopped = True
    table.update(3)
    table.stopped = False
    assert table.update(60) == []


def test_a_restarted_controller_gives_the_robot_at_once_to_who_had_it() -> None:
    had, acted, waits = policy(), script(), person(act=3)
    had.holding, acted.act, waits.wants = True, 0, False
    table = Table(waits, acted, had)
    assert _kinds(table.update()) == [(Change.RESUMED, "policy")]
    assert table.update(60) == []


def test_of_two_who_believe_to_have_the_robot_the_higher_then_the_smaller_boot_has_it() -> None:
    low, high, same = policy(boot=1), person("b", 9, act=2), person("a", 8, act=2)
    low.holding = high.holding = same.holding = True
    table = Table(low)
    assert table.update()[-1].holder == "policy"
    table.operators.append(high)
    assert _kinds(table.update()) == [(Change.RESUMED, "b")]
    table.operators.append(same)
    assert _kinds(table.update()) == [(Change.RESUMED, "a")]
    table.update(60)
    assert table.holder == "a"


def test_while_it_listens_a_controller_follows_only_acts_that_it_sees_to_be_new() -> None:
    had, other, newcomer = person("had", 1, act=1), person("other", 2, act=5), person("new", 3)
    had.holding = True
    table = Table(had, other, newcomer)
    table.update(2)
    assert table.holder == "had"
    acts(newcomer)
    assert _kinds(table.update()) == [(Change.TAKEN, "new")]
    # What the first believed is settled by that.
    assert table.update(60) == []
    free = Table(person("new", 3))
    free.update()
    acts(free.operators[0])
    assert _kinds(free.update()) == [(Change.GRANTED, "new")]


def test_a_person_who_wants_the_robot_goes_before_a_script_that_believes_to_have_it() -> None:
    program, someone = script(), person(act=1)
    program.holding = True
    table = Table(program)
    table.update()
    table.operators.append(someone)
    assert _kinds(table.update()) == [(Change.TAKEN, "keyboard")]


def test_a_plant_whose_time_begins_again_ends_no_lease() -> None:
    machine = policy()
    table = Table(machine, now=50 * 10**9).settle()
    table.now = 0
    assert table.update(40) == []
    machine.silent = True
    assert _kinds(table.update(21)) == [(Change.EXPIRED, "")]
    # A controller that has decided nothing yet listens anew.
    table = Table(machine, now=50 * 10**9)
    table.update()
    table.now = 0
    machine.silent = False
    assert table.update(20) == []
    assert table.update()[-1].holder == "policy"


# Random histories.

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


def test_at_first_nobody_has_had_the_robot() -> None:
    state = Authority(CONFIG).state
    assert (state.holder, state.holder_boot, state.previous, state.previous_boot) == ("", 0, "", 0)
    assert (state.change, state.changes, state.since) == (Change.NONE, 0, 0)
    assert (state.kind, state.ignored, state.header.stamp) == (POLICY, 0, 0)


@pytest.mark.parametrize("lease", [0.5, 2.0])
def test_the_lease_is_as_configured_and_ends_after_its_last_moment(lease: float) -> None:
    holder = script()
    table = Table(holder, config=AuthorityConfig(lease=lease))
    ticks = round(lease * 1e9) // TICK
    assert table.update(ticks) == []
    assert _kinds(table.update()) == [(Change.GRANTED, "teleop")]
    holder.silent = True
    assert table.update(ticks) == []
    assert table.authority.state.waiting == []
    assert _kinds(table.update()) == [(Change.EXPIRED, "")]


def test_a_claimant_waits_until_the_last_moment_of_its_lease() -> None:
    waiting = policy()
    table = Table(script(), waiting).settle()
    waiting.silent = True
    table.update(20)
    assert table.authority.state.waiting == ["policy"]
    table.update()
    assert table.authority.state.waiting == []


def test_of_equals_the_first_that_came_goes_first() -> None:
    first, second = policy("zebra", 9), policy("ant", 1)
    table = Table(first)
    table.update(2)
    table.operators.insert(0, second)
    table.settle()
    assert table.holder == "zebra"


def test_the_same_moment_again_renews_no_lease() -> None:
    holder = script()
    table = Table(holder).settle()
    holder.silent = True
    table.update(18)
    table.now -= TICK
    assert table.update() == []
    table.update(2)
    assert table.holder == "teleop"
    assert _kinds(table.update()) == [(Change.EXPIRED, "")]


def test_after_a_restart_of_the_plant_leases_begin_anew_and_nobody_has_to_wait() -> None:
    holder, waiting = script(), policy()
    table = Table(holder, waiting, now=100 * 10**9).settle()
    holder.silent = True
    table.update(10)
    table.now = 10**9
    assert table.update(15) == []
    assert table.holder == "teleop", "its claims may just be on their way"
    holder.silent, holder.wants = False, False
    assert _kinds(table.update()) == [(Change.RELEASED, ""), (Change.GRANTED, "policy")]
