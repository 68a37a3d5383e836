"""Decoding of a terminal's bytes into names of keys; pure.

Names are the character that a key gives (``w``, ``ч``), or ``up``, ``space``, ``Enter``, ``Esc``,
``Backspace`` and the like, after ``Alt-`` and ``Ctrl-`` if these were held. Three encodings are
understood: the old one of VT100 and xterm, xterm's ``modifyOtherKeys`` and the "kitty keyboard
protocol" (https://sw.kovidgoyal.net/kitty/keyboard-protocol/), which a program that ran before may
have left switched on.
"""

import codecs
import re
from typing import Final

UNKNOWN: Final = "unknown key"

_ARROWS: Final = {"A": "up", "B": "down", "C": "right", "D": "left"}
_NAMED: Final = {
    " ": "space", "\x1b": "Esc", "\r": "Enter", "\n": "Enter", "\t": "Tab",
    "\x7f": "Backspace", "\x08": "Backspace",
}  # fmt: skip
_DELETE: Final = "3"
_OTHER_KEY: Final = "27"
_PARAMETERS: Final = r"\x1b{1,2}\[(?P<%s>[0-9;:<=>?]*)[ -/]*"
_SEQUENCE: Final = re.compile(
    rf"(?P<part>(?:{_PARAMETERS % 'begun'}|\x1bO|\x1b+)\Z)"
    rf"|{_PARAMETERS % 'parameters'}(?P<csi>[@-~])|\x1bO(?P<ss3>.)|\x1b(?P<alt>.)|(?P<key>.)",
    re.DOTALL,
)
"""One key, or the incomplete one at the end of the input (ECMA-48 control sequences)."""
_SHIFT_ALT_CTRL_SUPER: Final = (1, 2, 4, 8)
_RELEASED: Final = "3"


class KeyDecoder:
    """Decodes the bytes of a terminal into names of keys.

    Esc and the first byte of an arrow key are the same: an Esc counts as a key only if nothing has
    followed by the next :meth:`feed`.
    """

    def __init__(self) -> None:
        self._text = codecs.getincrementaldecoder("utf-8")(errors="replace")
        self._pending = ""

    def feed(self, data: bytes) -> list[str]:
        """Return the keys completed by ``data``; call it at every poll, also without data."""
        if not data:
            waiting, self._pending = self._pending, ""
            if not waiting:
                return []
            return ["Esc"] if waiting == "\x1b" else [UNKNOWN]
        text = self._pending + self._text.decode(data)
        keys: list[str] = []
        position = 0
        while match := _SEQUENCE.match(text, position):
            if match["part"]:
                break
            if name := _name(match):
                keys.append(name)
            position = match.end()
        self._pending = text[position:]
        return keys


def _name(match: "re.Match[str]") -> str:
    """Return the name of a key; empty for a key that was released."""
    if match["csi"]:
        return _control_sequence(match["csi"], match["parameters"].split(";"))
    if match["ss3"]:
        return _ARROWS.get(match["ss3"], UNKNOWN)
    if match["alt"]:
        return f"Alt-{_character(match['alt'])}"
    return _character(match["key"])


def _character(char: str) -> str:
    """Return the name of the key that gives a character, possibly with Ctrl."""
    if char in _NAMED:
        return _NAMED[char]
    if ord(char) <= 26:
        return f"Ctrl-{chr(ord('a') - 1 + ord(char))}" if char != "\0" else "Ctrl-space"
    return char


def _control_sequence(final: str, parameters: list[str]) -> str:
    """Return the name of a key from its control sequence; empty if it was released."""
    fields = [*parameters, "", "", ""]
    modifiers, _, event = fields[1].partition(":")
    if event == _RELEASED:
        return ""
    if final == "u":
        # Code, with shift, and in the base layout, which tells an x in any script.
        code, *others = fields[0].split(":")
        return _modified(others[1] if len(others) == 2 else code, modifiers)
    if final == "~" and fields[0] == _OTHER_KEY:
        return _modified(fields[2], modifiers)
    if final == "~" and fields[0] == _DELETE:
        return "Delete"
    if final in "xX":
        # No key is sent so: an x was typed after an Esc and a bracket.
        return final
    return _ARROWS.get(final, UNKNOWN)


def _modified(code: str, modifiers: str) -> str:
    """Return the name of a key by its code point; Shift and the locks are left out."""
    number = int(code) if code.isdecimal() else 0
    if not 0 < number < 0xE000:
        return UNKNOWN
    held = int(modifiers) - 1 if modifiers.isdecimal() and int(modifiers) > 0 else 0
    _shift, alt, ctrl, system = (bool(held & bit) for bit in _SHIFT_ALT_CTRL_SUPER)
    prefix = "Alt-" * (alt or system) + "Ctrl-" * ctrl
    return prefix + _NAMED.get(chr(number), chr(number))
