"""What an operator claims, and when it believes that it has the robot."""

from typing import Any

import pytest

from common.operator.claim import PATIENCE, Claimant, own_replies
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    GaitOutcome,
    GaitReply,
    OperatorClaim,
    OperatorKind,
    Sender,
)
from common.schemas.operator import Gait
from common.topics import WBC_AUTHORITY
from tests.services.inputs import FakeInputs
from tests.services.teleop.support import BOOT, authority

ME = Sender("me", BOOT)
MINE = authority("me", BOOT)
UNKNOWN = authority(change=AuthorityChange.NONE)
PERSON, SCRIPT, POLICY = OperatorKind.PERSON, OperatorKind.SCRIPT, OperatorKind.POLICY


def tell(claimant: Claimant, *said: AuthorityState, stopped: bool = False) -> bool:
    inputs = FakeInputs()
    for message in said:
        inputs.put(WBC_AUTHORITY, message.model_copy())
        claimant.update(inputs, ME, stopped=stopped)
    return claimant.has_robot


def claim(claimant: Claimant) -> OperatorClaim | None:
    """The claim sent now; None if nothing has changed."""
    sent = claimant.claims(0, 9)
    message = sent[0].message if sent else None
    assert message is None or isinstance(message, OperatorClaim)
    return message


@pytest.mark.parametrize(
    ("kind", "wants", "act"), [(PERSON, False, 0), (SCRIPT, True, 1), (POLICY, True, 0)]
)
def test_what_each_kind_claims_at_its_start(kind: OperatorKind, wants: bool, act: int) -> None:
    first = claim(Claimant(kind))
    assert first is not None
    assert (first.kind, first.wants, first.act, first.holding) == (kind, wants, act, False)
    assert first.header.stamp == 9


def test_a_claim_is_repeated_at_10_hz_and_sent_at_once_when_it_changes() -> None:
    claimant = Claimant(PERSON)
    times = [t for t in range(0, 1000, 50) if claimant.claims(t * 1_000_000, 0)]
    assert times == list(range(0, 1000, 100))
    jitter = [claimant.claims(t * 1_000_000, 0) for t in (1001, 1049, 1098, 1152, 1199)]
    assert [bool(claims) for claims in jitter] == [True, False, True, False, True]
    claimant.ask(1.0)
    assert claimant.claims(1_200_000_000, 0)


@pytest.mark.parametrize("kind", [SCRIPT, POLICY])
def test_a_script_or_policy_goes_on_wanting_what_it_loses(kind: OperatorKind) -> None:
    claimant = Claimant(kind)
    assert tell(claimant, MINE)
    assert claimant.claims(0, 0)[0].message.holding  # type: ignore[attr-defined]
    assert not tell(claimant, authority("keyboard", 5, AuthorityChange.TAKEN, "me"))
    assert claimant.wants
    assert claimant.acts == (kind is SCRIPT)
    assert claimant.waits_for() == "keyboard has the robot"
    assert tell(claimant, authority("me", BOOT, AuthorityChange.GRANTED, "keyboard"))


def test_a_person_asks_each_time() -> None:
    claimant = Claimant(PERSON)
    tell(claimant, UNKNOWN)
    claimant.ask(1.0)
    assert (claimant.wants, claimant.acts) == (True, 1)
    assert tell(claimant, MINE)
    assert not tell(claimant, authority("me", 5, AuthorityChange.TAKEN, "me"))
    assert not claimant.wants
    assert claimant.waits_for() == "another me has the robot"
    claimant.ask(2.0)
    assert (claimant.wants, claimant.acts) == (True, 2)


def test_what_a_person_gives_back_is_given_back_at_once() -> None:
    claimant = Claimant(PERSON)
    claimant.ask(1.0)
    assert tell(claimant, MINE)
    claimant.release()
    assert not tell(claimant, MINE)


def test_who_gives_it_back_and_asks_at_once_is_not_confused_by_old_word() -> None:
    claimant = Claimant(PERSON)

    def said(changes: int, *fields: Any) -> bool:
        return tell(claimant, authority(*fields).model_copy(update={"changes": changes}))

    claimant.ask(1.0)
    assert said(1, "me", BOOT)
    claimant.release()
    claimant.ask(1.2)
    # On a link of half a second this still comes: it has the robot, then that it gave it back.
    assert not said(1, "me", BOOT)
    assert not said(2, "", 0, AuthorityChange.RELEASED, "me")
    assert claimant.wants
    assert not claimant.give_up(1.3)
    assert said(3, "me", BOOT)


def test_a_wish_that_nobody_grants_is_withdrawn() -> None:
    claimant = Claimant(PERSON)
    claimant.ask(1.0)
    assert not claimant.give_up(1.0 + PATIENCE - 0.01)
    assert claimant.give_up(1.0 + PATIENCE)
    assert not claimant.wants
    assert not claimant.give_up(9.0)


def test_a_restarted_controller_is_told_who_had_the_robot() -> None:
    claimant = Claimant(SCRIPT)
    assert tell(claimant, MINE, UNKNOWN, UNKNOWN)
    assert tell(claimant, authority("me", BOOT, AuthorityChange.RESUMED))


def test_no_old_word_gives_the_robot_back_after_a_stop() -> None:
    claimant, inputs = Claimant(SCRIPT), FakeInputs()
    inputs.put(WBC_AUTHORITY, MINE)
    claimant.update(inputs, ME, stopped=False)
    assert claimant.has_robot
    for stopped in (True, False, False):
        claimant.update(inputs, ME, stopped=stopped)
        assert not claimant.has_robot


def test_replies_to_others_are_left_out() -> None:
    replies = [
        GaitReply(request_id=1, gait=Gait.FORWARD, outcome=GaitOutcome.ACCEPTED, requester_boot=b)
        for b in (0, BOOT, BOOT + 1)
    ]
    assert own_replies(replies, BOOT) == replies[:2]


@pytest.mark.parametrize("change", list(AuthorityChange))
def test_every_change_has_words(change: AuthorityChange) -> None:
    assert authority("a", 5, change, "b").reason
