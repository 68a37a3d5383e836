import string

import pytest

from common.schemas import Gait
from services.teleop.keyboard.keymap import (
    BY_KEY,
    KEYMAP,
    Action,
    KeyDecoder,
    MoveHands,
    RequestGait,
    SelectHands,
    TurnHands,
)
from services.teleop.keyboard.screen import WIDTH, help_lines


def test_no_key_is_bound_twice() -> None:
    assert sum(len(binding.keys) for binding in KEYMAP) == len(BY_KEY)


def test_every_gait_and_every_hand_direction_has_a_key() -> None:
    commands = [binding.command for binding in KEYMAP]
    assert {c.gait for c in commands if isinstance(c, RequestGait)} == set(Gait) - {Gait.NONE}
    for kind in (MoveHands, TurnHands):
        ways = {(c.axis, c.sign) for c in commands if isinstance(c, kind)}
        assert ways == {(axis, sign) for axis in "xyz" for sign in (-1, 1)}
    assert {c.sides for c in commands if isinstance(c, SelectHands)} == {
        ("left",),
        ("right",),
        ("left", "right"),
    }
    names = {c.name for c in commands if isinstance(c, Action)}
    assert names == {"grip", "home", "push", "pause", "reset", "estop", "quit"}


def test_what_would_be_costly_by_accident_needs_two_presses() -> None:
    twice = {binding.command for binding in KEYMAP if binding.twice}
    assert twice == {Action("reset"), Action("estop")}


@pytest.mark.parametrize("binding", KEYMAP, ids=lambda binding: binding.label)
def test_every_key_stands_in_the_help_on_the_screen(binding: object) -> None:
    assert any(f" {binding.label} {binding.help}" in line for line in help_lines())  # type: ignore[attr-defined]


def test_help_fits_the_screen() -> None:
    assert len(help_lines()) == 10
    assert max(map(len, help_lines())) <= WIDTH


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"w", ["w"]),
        (b"ws q", ["w", "s", "space", "q"]),
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        (b"\x1bOA\x1bOD", ["up", "left"]),
        (b"\x1b[1;5Aw", ["up", "w"]),
        (b"\x1b\x1b[Aw", ["up", "w"]),
        (b"\x1b[15~w", ["unknown key", "w"]),
        (b"\x1bw1", ["Alt-w", "1"]),
        ("ä1".encode(), ["ä", "1"]),
        (b"\xffw", ["\ufffd", "w"]),
    ],
)
def test_bytes_become_keys(data: bytes, keys: list[str]) -> None:
    assert KeyDecoder().feed(data) == keys


def test_a_lone_escape_is_a_key_once_nothing_follows() -> None:
    decoder = KeyDecoder()
    assert decoder.feed(b"w\x1b") == ["w"]
    assert decoder.feed(b"") == ["Esc"]
    assert decoder.feed(b"") == []


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 5])
def test_a_sequence_cut_in_two_is_one_key(cut: int) -> None:
    data = b"\x1b[1;5A"
    decoder = KeyDecoder()
    assert decoder.feed(data[:cut]) + decoder.feed(data[cut:]) == ["up"]


def test_an_unfinished_sequence_is_not_taken_for_escape() -> None:
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b[1") == []
    assert decoder.feed(b"") == ["unknown key"]


def test_every_printable_character_is_one_key() -> None:
    text = string.ascii_letters + string.digits + string.punctuation
    assert KeyDecoder().feed(text.encode()) == list(text)
