"""Who gets the robot, rule by rule."""

from collections.abc import Sequence

import pytest
from pydantic import ValidationError

from common.schemas import AuthorityChange as Change
from common.schemas import AuthorityState, Sender
from services.wbc.authority import Authority
from services.wbc.config import AuthorityConfig

from .operators import (
    CONFIG,
    PERSON,
    POLICY,
    SCRIPT,
    TICK,
    Operator,
    Table,
    acts,
    person,
    policy,
    script,
)


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
