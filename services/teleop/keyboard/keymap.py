"""Keys of the keyboard operator: decoding of terminal input, and bindings; pure.

:data:`KEYMAP` holds all bindings; the help on the screen is generated from it.
"""

import re
from dataclasses import dataclass
from typing import Final, Literal

from common.schemas import Gait

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class RequestGait:
    """Request a gait."""

    gait: Gait


@dataclass(frozen=True)
class SelectHands:
    """Select the hands that the hand keys move."""

    sides: tuple[str, ...]


@dataclass(frozen=True)
class MoveHands:
    """Move the selected hands one step along a body axis."""

    axis: Axis
    sign: int


@dataclass(frozen=True)
class TurnHands:
    """Rotate the selected hands one step about a body axis."""

    axis: Axis
    sign: int


@dataclass(frozen=True)
class PitchHead:
    """Pitch the head one step; positive looks down."""

    sign: int


@dataclass(frozen=True)
class Action:
    """An action without parameters."""

    name: Literal["grip", "home", "push", "pause", "reset", "estop", "quit"]


Command = RequestGait | SelectHands | MoveHands | TurnHands | PitchHead | Action


@dataclass(frozen=True)
class Binding:
    """Keys and their command.

    Attributes:
        keys: any of them.
        command: what they do.
        help: for the screen.
        twice: whether the key must be pressed twice in a row.
    """

    keys: tuple[str, ...]
    command: Command
    help: str
    twice: bool = False

    @property
    def label(self) -> str:
        """Keys as shown in the help."""
        return " ".join(self.keys * 2) if self.twice else " ".join(self.keys)


KEYMAP: Final[tuple[Binding, ...]] = (
    Binding(("w",), RequestGait(Gait.FORWARD), "walk forward"),
    Binding(("s",), RequestGait(Gait.BACKWARD), "walk backward"),
    Binding(("a",), RequestGait(Gait.TURN_LEFT), "turn left"),
    Binding(("d",), RequestGait(Gait.TURN_RIGHT), "turn right"),
    Binding(("q",), RequestGait(Gait.SIDE_LEFT), "step left"),
    Binding(("e",), RequestGait(Gait.SIDE_RIGHT), "step right"),
    Binding(("1",), SelectHands(("left",)), "select left hand"),
    Binding(("2",), SelectHands(("right",)), "select right hand"),
    Binding(("3",), SelectHands(("left", "right")), "select both"),
    Binding(("h",), Action("home"), "hand home"),
    Binding(("i", "up"), MoveHands("x", 1), "hand forward"),
    Binding(("k", "down"), MoveHands("x", -1), "hand back"),
    Binding(("j", "left"), MoveHands("y", 1), "hand left"),
    Binding(("l", "right"), MoveHands("y", -1), "hand right"),
    Binding(("u",), MoveHands("z", 1), "hand up"),
    Binding(("o",), MoveHands("z", -1), "hand down"),
    Binding(("g",), Action("grip"), "grip / release"),
    Binding(("n",), PitchHead(-1), "look up"),
    Binding(("m",), PitchHead(1), "look down"),
    Binding(("space",), Action("pause"), "pause / resume"),
    Binding(("t",), TurnHands("x", -1), "roll left"),
    Binding(("y",), TurnHands("x", 1), "roll right"),
    Binding(("f",), TurnHands("y", -1), "pitch up"),
    Binding(("v",), TurnHands("y", 1), "pitch down"),
    Binding(("z",), TurnHands("z", 1), "yaw left"),
    Binding(("c",), TurnHands("z", -1), "yaw right"),
    Binding(("p",), Action("push"), "push the torso"),
    Binding(("r",), Action("reset"), "reset the plant", twice=True),
    Binding(("x",), Action("estop"), "EMERGENCY STOP", twice=True),
    Binding(("Esc",), Action("quit"), "quit (or Ctrl-C)"),
)
"""All bindings, column by column as in the help."""

BY_KEY: Final[dict[str, Binding]] = {key: b for b in KEYMAP for key in b.keys}

_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_NAMED: Final = {" ": "space"}
_PARAMETERS: Final = r"\x1b{1,2}\[[0-9;:<=>?]*[ -/]*"
_SEQUENCE: Final = re.compile(
    rf"(?P<part>(?:{_PARAMETERS}|\x1bO|\x1b+)\Z)"
    rf"|{_PARAMETERS}(?P<csi>[@-~])|\x1bO(?P<ss3>.)|\x1b(?P<alt>.)|(?P<key>.)",
    re.DOTALL,
)
"""One key, or the incomplete one at the end of the input (ECMA-48 control sequences)."""


class KeyDecoder:
    """Decodes the bytes of a terminal into names of keys.

    Esc and the first byte of an arrow key are the same: an Esc counts as a key only if nothing has
    followed by the next :meth:`feed`.
    """

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> list[str]:
        """Return the keys completed by ``data``; call it at every poll, also without data."""
        if not data:
            waiting, self._pending = self._pending, b""
            if not waiting:
                return []
            return ["Esc"] if waiting == b"\x1b" else ["unknown key"]
        text = (self._pending + data).decode("utf-8", errors="replace")
        keys: list[str] = []
        position = 0
        while match := _SEQUENCE.match(text, position):
            if match["part"]:
                break
            keys.append(_name(match))
            position = match.end()
        self._pending = text[position:].encode()
        return keys


def _name(match: "re.Match[str]") -> str:
    if sequence := match["csi"] or match["ss3"]:
        return _ARROWS.get(sequence, "unknown key")
    if match["alt"]:
        return f"Alt-{match['alt']}"
    return _NAMED.get(match["key"], match["key"])
