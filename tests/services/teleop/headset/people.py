"""People at pages: what their browsers and headsets would send, and a bench for the operator."""

import json
from typing import Any

from common.topics import TELEOP_GAIT, TELEOP_SETPOINT
from services.teleop.headset.hub import Event
from services.teleop.headset.protocol import Incoming, parse
from services.teleop.headset.service import HeadsetOperator
from tests.services.teleop.support import Bench, FakeController

STEP_NS = 10_000_000
FORWARD_GRIP = [1.0, 0.0, 0.0, 0.0]


def grip(x: float, y: float, z: float, **buttons: Any) -> dict[str, Any]:
    """A controller at a place of WebXR's floor space: x right, y up, z back [m]."""
    return {"position": [x, y, z], "quaternion": FORWARD_GRIP, "tracked": True, **buttons}


def message(kind: str, t: float, **fields: Any) -> dict[str, Any]:
    return {"type": kind, "t": t, **fields}


class Person:
    """One page. Its clock has nothing to do with the server's."""

    def __init__(self, room: "Room", page: int) -> None:
        self.room, self.page, self.clock_ms = room, page, 1e6 * page
        self.head: dict[str, Any] = {
            "position": [0.0, 1.6, 0.0],
            "quaternion": [1.0, 0.0, 0.0, 0.0],
            "tracked": True,
        }
        self.left, self.right = grip(-0.25, 1.2, -0.4), grip(0.25, 1.2, -0.4)

    def send(self, kind: str, late: float = 0.0, **fields: Any) -> None:
        """Send a message that arrives now, after ``late`` [s] more than the shortest way."""
        now_ns = self.room.bench.now_ns
        sent = self.clock_ms + 1e-6 * now_ns - 1e3 * late
        self.room.put(self.page, parse_dict(message(kind, sent, **fields)), now_ns)

    def sample(self, **fields: Any) -> None:
        self.send("sample", head=self.head, left=self.left, right=self.right, **fields)

    def key(self, *keys: str, run: float = 0.1) -> "Person":
        for key in keys:
            self.send("key", key=key)
            self.watch(0.02)
        return self.watch(run)

    def watch(self, seconds: float) -> "Person":
        """Look at the page, which says so at 10 Hz."""
        for _ in range(round(seconds / 0.1) or 1):
            self.send("alive")
            self.room.run(min(seconds, 0.1))
        return self

    def wear(self, seconds: float) -> "Person":
        """Wear the headset, whose samples come at 50 Hz."""
        for _ in range(round(seconds / 0.02)):
            self.sample()
            self.room.run(0.02)
        return self

    def squeeze(self, side: str, seconds: float = 0.1) -> "Person":
        getattr(self, side)["squeeze"] = 1.0
        return self.wear(seconds)

    def leave(self) -> None:
        self.room.put(self.page, None, self.room.bench.now_ns)

    @property
    def told(self) -> dict[str, Any]:
        """What only this page is told."""
        return self.room.operator.driver.reply(self.page, self.room.bench.now_ns)


def parse_dict(values: dict[str, Any]) -> Incoming:
    return parse(json.dumps(values))


class Room:
    """The operator, its pages, and a controller that is invented."""

    def __init__(self, controller: FakeController | None = None) -> None:
        self.operator = HeadsetOperator()
        self.bench = Bench(self.operator, controller or FakeController())
        self.people = 0

    def enter(self) -> Person:
        self.people += 1
        person = Person(self, self.people)
        person.watch(0.1)
        return person

    def put(self, page: int, message: Incoming | None, at_ns: int) -> None:
        self.operator.hub.put(Event(page, message, at_ns))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.bench.tick(STEP_NS)

    @property
    def has_robot(self) -> bool:
        return self.operator.driver.console.claimant.has_robot

    @property
    def notice(self) -> str:
        return self.operator.driver.console.notice

    @property
    def setpoints(self) -> list[Any]:
        return self.bench.messages(TELEOP_SETPOINT)

    @property
    def gaits(self) -> list[str]:
        return [request.gait.name for request in self.bench.messages(TELEOP_GAIT)]
