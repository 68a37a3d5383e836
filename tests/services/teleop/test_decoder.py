"""Decoding of a terminal's bytes into names of keys."""

import string

import pytest

from services.teleop.keyboard.decoder import KeyDecoder
from services.teleop.keyboard.keymap import binding_of


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
        (b"\r\n\t\x7f\x08", ["Enter", "Enter", "Tab", "Backspace", "Backspace"]),
        (b"\x1b[3~\x1b[3;5~", ["Delete", "Delete"]),
        (b"\x18\x00", ["Ctrl-x", "Ctrl-space"]),
        (b"\x1b[119u\x1b[119;5u\x1b[27u", ["w", "Ctrl-w", "Esc"]),
        (b"\x1b[119;65u\x1b[119:87;2uw", ["w", "w", "w"]),
        (b"\x1b[1094::119uw", ["w", "w"]),
        (b"\x1b[119;1:3u\x1b[1;1:3Aw", ["w"]),
        (b"\x1b[27;5;119~", ["Ctrl-w"]),
        (b"\x1b[57358u\x1b[u", ["unknown key"] * 2),
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


@pytest.mark.parametrize(
    "data",
    [
        b"x",
        b"X",  # Caps Lock or Shift
        "ч".encode(),
        "Ч".encode(),
        "χ".encode(),
        "Χ".encode(),
        "ס".encode(),
        "ء".encode(),
        "ط".encode(),
        "դ".encode(),
        "ղ".encode(),
        "ხ".encode(),
        "\uff58".encode(),
        "\uff38".encode(),
        b"\x1bx",  # Alt
        b"\x1bX",
        "\x1bч".encode(),
        b"\x18",  # Ctrl
        b"\x1b\x18",
        b"\xc3\xb8",  # Alt, where a terminal sets the eighth bit
        b"\x1b[120u",
        b"\x1b[120;5u",
        b"\x1b[120:88;2u",
        b"\x1b[120;65u",  # Caps Lock
        b"\x1b[120;193u",  # and Num Lock
        b"\x1b[120;1:1;120u",
        b"\x1b[120;1:2u",  # held down
        b"\x1b[1095::120u",
        b"\x1b[1095:1063:120;2u",
        b"\x1b[1095;5u",
        b"\x1b[27;5;120~",
        b"\x1b[27;6;88~",
        b"\x1b[x",  # after a stray Esc and bracket
        b"\x7f",
        b"\x08",
        b"\x1b\x7f",
        b"\x1b[127u",
        b"\x1b[127;5u",
        b"\x1b[3~",
        b"\x1b[3;2~",
        b"\x1b[3;1:1~",
    ],
)
def test_one_press_of_x_stops_whatever_the_terminal_makes_of_it(data: bytes) -> None:
    for cut in range(len(data)):
        decoder = KeyDecoder()
        (key,) = decoder.feed(data[:cut]) + decoder.feed(data[cut:])
        assert binding_of(key) is binding_of("x")


def test_letting_the_key_go_is_no_second_press() -> None:
    assert KeyDecoder().feed(b"\x1b[120;1:1u\x1b[120;1:3u") == ["x"]
    assert KeyDecoder().feed(b"\x1b[3;1:3~") == []


def test_a_character_cut_in_two_is_one_key() -> None:
    decoder = KeyDecoder()
    assert decoder.feed("ч".encode()[:1]) == []
    assert decoder.feed("ч".encode()[1:]) == ["ч"]
