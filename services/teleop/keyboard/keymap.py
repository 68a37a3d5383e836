"""From bytes of a terminal to keys, and from keys to what the operator wants; pure.

:data:`KEYMAP` is the only place where keys are bound; the help on the screen is made from it.
"""

import re
from dataclasses import dataclass
from typing import Final, Literal

from common.schemas import Gait

Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class Walk:
    """Request a gait."""

    gait: Gait


@dataclass(frozen=True)
class Select:
    """Choose the hands that the hand keys move."""

    sides: tuple[str, ...]


@dataclass(frozen=True)
class Shift:
    """Move the selected hands one step along a body axis."""

    axis: Axis
    sign: int


@dataclass(frozen=True)
class Turn:
    """Turn the selected hands one step about a body axis."""

    axis: Axis
    sign: int


@dataclass(frozen=True)
class Look:
    """Pitch the head one step; positive looks down."""

    sign: int


@dataclass(frozen=True)
class Do:
    """Anything without a parameter."""

    what: Literal["grip", "home", "push", "pause", "reset", "estop", "quit"]


Command = Walk | Select | Shift | Turn | Look | Do


@dataclass(frozen=True)
class Binding:
    """Keys and what they ask for; ``twice``: only when pressed twice in a row."""

    keys: tuple[str, ...]
    command: Command
    help: str
    twice: bool = False

    @property
    def label(self) -> str:
        """The keys as the help shows them."""
        return " ".join(self.keys * 2) if self.twice else " ".join(self.keys)


KEYMAP: Final[tuple[Binding, ...]] = (
    Binding(("w",), Walk(Gait.FORWARD), "walk forward"),
    Binding(("s",), Walk(Gait.BACKWARD), "walk backward"),
    Binding(("a",), Walk(Gait.TURN_LEFT), "turn left"),
    Binding(("d",), Walk(Gait.TURN_RIGHT), "turn right"),
    Binding(("q",), Walk(Gait.SIDE_LEFT), "step left"),
    Binding(("e",), Walk(Gait.SIDE_RIGHT), "step right"),
    Binding(("1",), Select(("left",)), "select left hand"),
    Binding(("2",), Select(("right",)), "select right hand"),
    Binding(("3",), Select(("left", "right")), "select both"),
    Binding(("h",), Do("home"), "hand home"),
    Binding(("i", "up"), Shift("x", 1), "hand forward"),
    Binding(("k", "down"), Shift("x", -1), "hand back"),
    Binding(("j", "left"), Shift("y", 1), "hand left"),
    Binding(("l", "right"), Shift("y", -1), "hand right"),
    Binding(("u",), Shift("z", 1), "hand up"),
    Binding(("o",), Shift("z", -1), "hand down"),
    Binding(("g",), Do("grip"), "grip / release"),
    Binding(("n",), Look(-1), "look up"),
    Binding(("m",), Look(1), "look down"),
    Binding(("space",), Do("pause"), "pause / resume"),
    Binding(("t",), Turn("x", -1), "roll left"),
    Binding(("y",), Turn("x", 1), "roll right"),
    Binding(("f",), Turn("y", -1), "pitch up"),
    Binding(("v",), Turn("y", 1), "pitch down"),
    Binding(("z",), Turn("z", 1), "yaw left"),
    Binding(("c",), Turn("z", -1), "yaw right"),
    Binding(("p",), Do("push"), "push the torso"),
    Binding(("r",), Do("reset"), "reset the plant", twice=True),
    Binding(("x",), Do("estop"), "EMERGENCY STOP", twice=True),
    Binding(("Esc",), Do("quit"), "quit (or Ctrl-C)"),
)
"""Every key there is, column by column as the help shows them."""

BY_KEY: Final[dict[str, Binding]] = {key: b for b in KEYMAP for key in b.keys}

_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_NAMED: Final = {" ": "space"}
_PARAMETERS: Final = r"\x1b{1,2}\[[0-9;:<=>?]*[ -/]*"
_SEQUENCE: Final = re.compile(
    rf"(?P<part>(?:{_PARAMETERS}|\x1bO|\x1b+)\Z)"
    rf"|{_PARAMETERS}(?P<csi>[@-~])|\x1bO(?P<ss3>.)|\x1b(?P<alt>.)|(?P<key>.)",
    re.DOTALL,
)
"""One key, or the part of one at the end of what has arrived (ECMA-48 control sequences)."""


class KeyDecoder:
    """Turns what a terminal sends into key names.

    A lone Esc and the start of an arrow key's sequence are the same byte: an Esc counts as the
    key only when nothing has followed by the next :meth:`feed`.
    """

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> list[str]:
        """Keys completed by ``data``; call it with nothing, too, once per poll."""
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
