"""Keys of the keyboard operator and what they do; pure.

:data:`KEYMAP` holds all bindings; the help on the screen is generated from it.
"""

import unicodedata
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

    name: Literal["take", "grip", "home", "push", "pause", "reset", "estop", "clear", "quit"]


Command = RequestGait | SelectHands | MoveHands | TurnHands | PitchHead | Action


@dataclass(frozen=True)
class Binding:
    """Keys and their command.

    Attributes:
        keys: any of them.
        command: what they do.
        help: for the screen.
        twice: whether the key must be pressed twice in a row.
        shown: the keys as shown in the help; empty: as they are called.
    """

    keys: tuple[str, ...]
    command: Command
    help: str
    twice: bool = False
    shown: str = ""

    @property
    def label(self) -> str:
        """Keys as shown in the help."""
        return self.shown or " ".join(self.keys * 2 if self.twice else self.keys)


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
    Binding(("i", "up"), MoveHands("x", 1), "hand forward", shown="i/Up"),
    Binding(("k", "down"), MoveHands("x", -1), "hand back", shown="k/Down"),
    Binding(("j", "left"), MoveHands("y", 1), "hand left", shown="j/Left"),
    Binding(("l", "right"), MoveHands("y", -1), "hand right", shown="l/Right"),
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
    Binding(("x", "Backspace", "Delete"), Action("estop"), "EMERGENCY STOP", shown="x/Bksp/Del"),
    Binding(("b",), Action("clear"), "end the stop", twice=True),
    Binding(("Enter",), Action("take"), "take / give back"),
    Binding(("Esc", "Ctrl-c"), Action("quit"), "quit (or Ctrl-C)", shown="Esc"),
)
"""All bindings, column by column as in the help."""

BY_KEY: Final[dict[str, Binding]] = {key: b for b in KEYMAP for key in b.keys}

_X_ELSEWHERE: Final = (
    "x"
    "\u0447\u045f"  # Cyrillic: che (Russian, Ukrainian and others), dzhe (Serbian, Macedonian)
    "\u03c7\u05e1"  # Greek, Hebrew
    "\u0564\u0572\u0581"  # Armenian: basic, phonetic, eastern
    "\u10ee\u10e9"  # Georgian: two layouts
    "\u0621\u0637"  # Arabic, Persian
    "\u0e1b\u0e9b\u1781\u1011"  # Thai, Lao, Khmer, Burmese
    "\u0902\u0982\u0a02\u0a82\u0b02\u0b82\u0c02\u0c82\u0d02"  # Indian scripts
    "\u314c\u30b5\u3055"  # Korean, Japanese
    "\u2248\xf8"  # Alt-x of macOS, and of terminals that set the eighth bit
)
"""Characters that the key called x gives in the usual layouts of other scripts.

From the layouts of xkeyboard-config (position AB02). None of them has another meaning here, so the
worst of a character too many is a stop too many.
"""


def _folded(char: str) -> str:
    """Return a character without the difference of case and width."""
    return unicodedata.normalize("NFKC", char).casefold()


STOP_CHARACTERS: Final = frozenset(map(_folded, _X_ELSEWHERE))
"""What stops the robot, in whatever case and width it is typed."""


def binding_of(key: str) -> Binding | None:
    """Return the binding of a key, named as by the decoder; None if it has none.

    Caps Lock and full-width letters make no difference. The stop also ignores the layout and every
    modifier key: whoever needs it does not look which are down.
    """
    *modifiers, plain = key.split("-") if len(key) > 1 else [key]
    folded = _folded(plain) if len(plain) == 1 else plain
    stop = BY_KEY["x"]
    if folded in STOP_CHARACTERS or plain in stop.keys:
        return stop
    return BY_KEY.get("-".join((*modifiers, folded)))
