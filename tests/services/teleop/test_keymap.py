import pytest

from common.schemas import Gait
from services.teleop.keyboard.keymap import (
    BY_KEY,
    KEYMAP,
    Action,
    MoveHands,
    RequestGait,
    SelectHands,
    TurnHands,
    binding_of,
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
    assert names == {
        *("take", "grip", "home", "push", "pause", "reset", "estop", "clear", "quit"),
    }


def test_what_would_be_costly_by_accident_needs_two_presses() -> None:
    twice = {binding.command for binding in KEYMAP if binding.twice}
    assert twice == {Action("reset"), Action("clear")}


@pytest.mark.parametrize("binding", KEYMAP, ids=lambda binding: binding.label)
def test_every_key_stands_in_the_help_on_the_screen(binding: object) -> None:
    assert any(f" {binding.label} {binding.help}" in line for line in help_lines())  # type: ignore[attr-defined]


def test_help_fits_the_screen() -> None:
    assert len(help_lines()) == 11
    assert max(map(len, help_lines())) <= WIDTH


@pytest.mark.parametrize(
    "key",
    [
        *("x", "X", "\uff58", "\uff38", "Ctrl-x", "Alt-x", "Alt-X", "Alt-Ctrl-x"),
        *("ч", "Ч", "Alt-ч", "џ", "χ", "Χ", "ס", "ء", "ط", "ղ", "Ղ", "ց", "ხ", "Ხ"),
        *("ป", "ㅌ", "サ", "ｻ", "\u0902", "ø", "≈"),
        *("Backspace", "Delete", "Ctrl-Backspace", "Alt-Delete"),
    ],
)
def test_the_stop_needs_no_certain_layout_case_width_or_modifier(key: str) -> None:
    binding = binding_of(key)
    assert binding is not None
    assert binding.command == Action("estop")
    assert not binding.twice


def test_caps_lock_and_width_make_no_difference_but_modifiers_do() -> None:
    forward = binding_of("w")
    assert forward is not None
    assert forward.command == RequestGait(Gait.FORWARD)
    assert binding_of("W") is forward
    assert binding_of("\uff57") is forward
    for key in ("Alt-w", "Ctrl-w", "ц", "-", "unknown key"):
        assert binding_of(key) is None
    quit_ = binding_of("Ctrl-c")
    assert quit_ is not None
    assert quit_.command == Action("quit")


def test_no_other_key_stops_and_no_stop_key_does_anything_else() -> None:
    stops = {key for key, binding in BY_KEY.items() if binding.command == Action("estop")}
    assert stops == {"x", "Backspace", "Delete"}
    assert {key for key in BY_KEY if binding_of(key) is binding_of("x")} == stops
