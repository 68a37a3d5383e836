"""Who had the robot, from what the controller said."""

from common.operator.holds import HoldBook
from common.schemas import AuthorityChange as Change
from common.schemas import AuthorityState, OperatorKind
from tests.common.operator.support import said

PERSON, SCRIPT = OperatorKind.PERSON, OperatorKind.SCRIPT


def book_of(*states: AuthorityState) -> tuple[HoldBook, list[str]]:
    """Each state comes twice, a second apart; the words of all hand-overs are returned too."""
    book, words = HoldBook(), []
    for at, state in enumerate(states):
        if book.observe(state, at) and book.handover:
            words.append(book.handover)
        assert not book.observe(state, at + 0.5)
    return book, words


def test_a_person_takes_over_from_a_policy_and_gives_back() -> None:
    book, words = book_of(
        said(0, Change.NONE),
        said(1, Change.GRANTED, "policy"),
        said(2, Change.TAKEN, "keyboard", PERSON),
        said(3, Change.RELEASED),
        said(4, Change.GRANTED, "policy"),
    )
    assert [(h.name, h.start, h.length(9.0), h.intervention, h.until) for h in book.holds] == [
        ("policy (policy)", 1, 1, False, "it was taken"),
        ("keyboard (person)", 2, 1, True, "it gave it back"),
        ("policy (policy)", 4, 5, False, ""),
    ]
    assert words == ["keyboard takes over", "keyboard lets go", "back to policy"]


def test_whoever_takes_over_from_an_intervention_intervenes_too() -> None:
    book, words = book_of(
        said(1, Change.GRANTED, "policy"),
        said(2, Change.EXPIRED),
        said(3, Change.GRANTED, "teleop", SCRIPT),
        said(4, Change.TAKEN, "keyboard", PERSON),
        said(5, Change.STOPPED),
    )
    assert [h.intervention for h in book.holds] == [False, True, True]
    assert words == ["teleop takes over", "keyboard takes over", "keyboard lets go"]


def test_without_a_policy_nobody_intervenes() -> None:
    book, words = book_of(
        said(1, Change.GRANTED, "teleop", SCRIPT), said(2, Change.TAKEN, "keyboard", PERSON)
    )
    assert [h.intervention for h in book.holds] == [False, False]
    assert words == []


def test_a_restarted_controller_that_finds_the_holder_goes_on_with_the_hold() -> None:
    book, _ = book_of(
        said(1, Change.GRANTED, "policy"),
        said(0, Change.NONE, boot=2),
        said(1, Change.RESUMED, "policy", boot=2),
    )
    (hold,) = book.holds
    assert (hold.start, hold.end) == (0, None)
