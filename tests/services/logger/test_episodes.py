"""Marks become episodes, in whatever order they arrive."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from common.schemas import EpisodeAction, EpisodeMark
from services.logger.read.episodes import (
    COMPLETE,
    DISCARDED,
    INTERRUPTED,
    Episode,
    EpisodeBook,
)

START, END, DISCARD = EpisodeAction.START, EpisodeAction.END, EpisodeAction.DISCARD


def mark(number: int, action: EpisodeAction, label: str = "") -> EpisodeMark:
    return EpisodeMark(episode=number, action=action, label=label)


def test_start_and_end() -> None:
    book = EpisodeBook()
    book.observe(mark(4, START, "door"), 100)
    assert (book.open, book.next_number) == (Episode(4, "door", 100), 5)
    done = Episode(4, "door", 100, 350, COMPLETE)
    book.observe(mark(4, END), 350)
    assert (book.open, book.finished, round(1e9 * done.seconds)) == (None, [done], 250)


def test_discard_keeps_the_remark() -> None:
    book = EpisodeBook()
    book.observe(mark(0, START, "door"), 1)
    book.observe(mark(0, DISCARD, "slipped"), 2)
    assert book.finished == [Episode(0, "slipped", 1, 2, DISCARDED)]


def test_a_start_interrupts_what_is_open() -> None:
    book = EpisodeBook()
    book.observe(mark(0, START), 1)
    book.observe(mark(1, START), 5)
    assert book.finished == [Episode(0, "", 1, 5, INTERRUPTED)]
    book.close(9)
    book.close(10)
    assert book.finished[1:] == [Episode(1, "", 5, 9, INTERRUPTED)]


def test_repeats_and_ends_of_nothing_change_nothing() -> None:
    book = EpisodeBook()
    book.observe(mark(3, END), 1)
    book.observe(mark(4, START, "a"), 2)
    book.observe(mark(4, START, "b"), 3)
    book.observe(mark(3, END), 4)
    assert (book.open, book.finished) == (Episode(4, "a", 2), [])


@given(st.lists(st.tuples(st.integers(0, 4), st.sampled_from(EpisodeAction)), max_size=40))
def test_every_started_episode_is_finished_once(marks: list[tuple[int, EpisodeAction]]) -> None:
    book = EpisodeBook()
    starts = 0
    for at, (number, action) in enumerate(marks, start=1):
        before = book.open
        book.observe(mark(number, action), at)
        starts += book.open is not None and book.open != before
        assert all(number < book.next_number for number, _ in marks[:at])
    book.close(100)
    assert starts == len(book.finished)
    spans = [(one.start_ns, one.end_ns) for one in book.finished]
    assert spans == sorted(spans)
    assert all(a[1] <= b[0] for a, b in itertools.pairwise(spans))
