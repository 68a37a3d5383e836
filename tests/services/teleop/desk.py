"""A keyboard operator at a screen and a robot that are both invented."""

from collections.abc import Sequence

from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_SETPOINT
from services.teleop.keyboard.service import KeyboardOperator

from .support import Bench, FakeController

ESCAPE = {"up": b"\x1b[A", "down": b"\x1b[B", "right": b"\x1b[C", "left": b"\x1b[D"}


class FakeScreen:
    def __init__(self) -> None:
        self.typed: list[bytes | None] = []
        self.lines: list[str] = []
        self.closed = 0

    def read(self) -> bytes | None:
        return self.typed.pop(0) if self.typed else b""

    def draw(self, lines: Sequence[str]) -> None:
        self.lines = list(lines)

    def close(self) -> None:
        self.closed += 1

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


class Desk:
    """A keyboard operator that has taken the robot, unless told not to, and its surroundings."""

    def __init__(self, controller: FakeController | None = None, *, take: bool = True) -> None:
        self.screen = FakeScreen()
        self.operator = KeyboardOperator(self.screen)
        self.bench = Bench(self.operator, controller or FakeController())
        self.bench.run(0.2)
        if take:
            self.type("Enter", run=0.1)

    def type(self, *keys: str, run: float = 0.05) -> "Desk":
        for key in keys:
            named = {"space": b" ", "Esc": b"\x1b", "Enter": b"\r"} | ESCAPE
            named |= {"Backspace": b"\x7f", "Delete": b"\x1b[3~", "Ctrl-c": b"\x1b[99;5u"}
            self.screen.typed.append(named.get(key, key.encode()))
        self.bench.run(0.05 * len(keys) + run)
        return self

    def hand(self, side: str) -> tuple[Array, Array]:
        message = self.bench.messages(TELEOP_SETPOINT)[-1]
        return (
            getattr(message, f"{side}_hand_position_in_body"),
            getattr(message, f"{side}_hand_quaternion_in_body"),
        )
