"""``trill stop``, ``trill resume``, ``trill reset`` against an invented plant on a real bus."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.plant.stop import StopRecord
from common.schemas import GuardMode, PlantAction, PlantState, PlantStatus
from common.topics import ESTOP, ESTOP_CLEAR, PLANT_REQUEST, PLANT_STATE, PLANT_STATUS
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id, open_session
from lab.cli.main import main
from lab.live import plant_remote
from tests.common.transport.support import examples, free_base_port

READS = (ESTOP, ESTOP_CLEAR, PLANT_REQUEST)
STATUS = next(m for m in examples() if isinstance(m, PlantStatus))
STATE = next(m for m in examples() if isinstance(m, PlantState))


class FakePlant:
    """Latches stops as a plant does, but misses the first messages of each kind.

    Attributes:
        deaf: number of messages of each topic that it misses.
        obeys: whether it does what it is asked.
        again: a stop that another presses as soon as one is cleared or a clear is heard.
        cleared, seeds: what it has heard.
    """

    def __init__(self, session: Any) -> None:
        boot = new_boot_id()
        self._status = Publisher(session, "draco3", PLANT_STATUS, "sim", boot)
        self._state = Publisher(session, "draco3", PLANT_STATE, "sim", boot)
        self._inbox = Inbox(READS)
        self._subscribers = subscribe(session, "draco3", self._inbox, READS)
        self._missed = dict.fromkeys(READS, 0)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.stop = StopRecord()
        self.deaf, self.obeys, self.again = 0, True, False
        self.resets = 0
        self.cleared: list[int] = []
        self.seeds: list[int] = []

    def __enter__(self) -> "FakePlant":
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers.clear()

    def _run(self) -> None:
        step = 0
        while not self._over.wait(0.01):
            step += 1
            self._inbox.begin_step(step)
            self._hear()
            if step % 3 == 0:
                self._status.send(self._told())
                self._state.send(STATE.model_copy(update={"reset_count": self.resets}))

    def _hear(self) -> None:
        for clear in self._heard(ESTOP_CLEAR):
            self.cleared.append(clear.stops)
            if self.again:
                self.stop = StopRecord(latched=True, stops=clear.stops + 1, by="keyboard")
            self.stop = self.stop.cleared(clear.stops)
        for button in self._heard(ESTOP):
            self.stop = self.stop.pressed(button.header.source, button.reason)
        for request in self._heard(PLANT_REQUEST):
            assert request.action is PlantAction.RESET
            self.resets += 1
            self.seeds.append(request.seed)

    def _heard(self, topic: Any) -> list[Any]:
        messages = self._inbox.events(topic) if self.obeys else []
        missed = min(len(messages), self.deaf - self._missed[topic])
        self._missed[topic] += missed
        return messages[missed:]

    def _told(self) -> PlantStatus:
        return STATUS.model_copy(
            update={
                "guard": GuardMode.ESTOP if self.stop.latched else GuardMode.DAMP,
                "stops": self.stop.stops,
                "stopped_by": self.stop.by,
                "stop_reason": self.stop.reason,
                "fallen": True,
            }
        )


@pytest.fixture
def base_port(monkeypatch: pytest.MonkeyPatch) -> int:
    for variable in ("TRILL_MODE", "TRILL_CONNECT", "TRILL_ROBOT", "TRILL_CONFIG"):
        monkeypatch.delenv(variable, raising=False)
    return free_base_port()


@pytest.fixture
def plant(base_port: int) -> Iterator[FakePlant]:
    with ExitStack() as stack:
        session: Any = open_session(BusConfig(base_port=base_port), "sim")
        stack.callback(session.close)
        yield stack.enter_context(FakePlant(session))


def test_a_stop_is_sent_until_confirmed_and_its_end_and_a_reset_too(
    plant: FakePlant, base_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--base-port", str(base_port)]
    plant.deaf = 30
    assert main(["stop", *where, "smoke", "somewhere"]) == 0
    assert plant.stop == StopRecord(
        latched=True, stops=1, by="trill-stop", reason="smoke somewhere"
    )
    said = capsys.readouterr().out
    assert "STOPPED (stop 1), by trill-stop: smoke somewhere" in said
    assert f"trill resume --base-port {base_port}" in said
    plant.deaf = 1
    assert main(["reset", *where, "--seed", "7"]) == 0
    assert (plant.resets, plant.seeds, plant.stop.latched) == (1, [7], True)
    assert "it stays STOPPED" in capsys.readouterr().out
    plant.deaf = 4
    assert main(["resume", *where]) == 0
    assert not plant.stop.latched
    assert set(plant.cleared) == {1}
    said = capsys.readouterr().out
    assert "no longer stopped (stop 1" in said
    assert "trill reset" in said
    assert main(["resume", *where]) == 0
    assert "nothing to end" in capsys.readouterr().out


def test_a_stop_that_comes_meanwhile_is_not_ended(
    plant: FakePlant, base_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    plant.stop, plant.again = StopRecord(latched=True, stops=4), True
    assert main(["resume", "--base-port", str(base_port)]) == 1
    assert plant.stop.latched
    assert "stopped again meanwhile, by keyboard" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["stop", "resume", "reset"])
def test_a_plant_that_does_not_obey_is_told_apart_from_none(
    command: str,
    plant: FakePlant,
    base_port: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(plant_remote, "TIMEOUT", 1.0)
    plant.stop, plant.obeys = StopRecord(latched=command == "resume", stops=1), False
    assert main([command, "--base-port", str(base_port)]) == 1
    assert "is heard, guard" in capsys.readouterr().err
    plant.__exit__()
    assert main([command, "--base-port", str(base_port)]) == 1
    said = capsys.readouterr().err
    assert "no plant of draco3 was heard" in said
    assert f"tcp/127.0.0.1:{base_port}" in said
