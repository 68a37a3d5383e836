"""Stop, clear and reset the plant from a shell: send until the plant confirms it."""

import contextlib
import getpass
import socket
import time
from collections.abc import Iterator
from typing import Any, Final, Self, TypeVar

from common.errors import SchemaError
from common.estop import StopButton
from common.schemas import (
    EstopClear,
    GuardMode,
    Message,
    PlantAction,
    PlantRequest,
    PlantState,
    PlantStatus,
)
from common.topics import ESTOP, ESTOP_CLEAR, PLANT_REQUEST, PLANT_STATE, PLANT_STATUS, Topic
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id, open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import decode
from lab.errors import LabError

TIMEOUT: Final = 5.0
"""Time after which a command gives up [s]."""
POLL_PERIOD: Final = 0.01
"""Between two looks at what has come [s]."""
STOP_PERIOD: Final = 0.03
"""Between two bursts of a stop [s]."""
CLEAR_PERIOD: Final = 0.1
"""Between two copies of a clear [s]."""
RESET_PERIOD: Final = 1.0
"""Time after which a reset that shows no effect is sent again [s]."""

M = TypeVar("M", bound=Message)


def who() -> str:
    """Return who runs this command, for the reason of a stop."""
    try:
        name = getpass.getuser()
    except (KeyError, OSError):
        name = "somebody"
    return f"{name} in a shell on {socket.gethostname()}"[:200]


class PlantRemote:
    """A session of its own on the bus, with which a person reaches the plant; a context manager.

    Attributes:
        status, state: newest messages of the plant; None before the first.
    """

    def __init__(self, bus: BusConfig, name: str) -> None:
        """Join the bus as ``name``, which the plant gives as the source of a stop.

        Raises:
            BusError: the bus cannot be opened.
        """
        self._bus, self._name, self._boot = bus, name, new_boot_id()
        patient = bus.model_copy(update={"patience_s": min(bus.patience_s, TIMEOUT)})
        self._session: Any = open_session(patient, name)
        keys = [subscription_of(bus.robot, topic) for topic in (PLANT_STATUS, PLANT_STATE)]
        self._tap = RawTap(self._session, bus.robot, expressions=keys)
        self.status: PlantStatus | None = None
        self.state: PlantState | None = None

    def __enter__(self) -> Self:
        """Enter the context; the bus is open already."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Leave the bus."""
        self._tap.close()
        self._session.close()

    def stop(self, reason: str) -> PlantStatus:
        """Stop the robot; return the status by which the plant confirms it.

        Raises:
            LabError: the plant does not answer, or does not stop.
        """
        button, publisher = StopButton(), self._publisher(ESTOP)
        button.press(reason, time.monotonic_ns())
        due = 0.0
        polls = self._polls("confirmed the stop")
        while True:
            heard = next(polls)
            now = time.monotonic()
            if heard is not None or now >= due:
                due = now + STOP_PERIOD
                for message in button.poll(time.monotonic_ns(), heard):
                    if message.pressed:
                        publisher.send(message)
            if button.pressed_ns is None and heard is not None:
                return heard

    def clear(self, reason: str) -> tuple[PlantStatus, PlantStatus]:
        """End the stop that is latched now; return the status before and after.

        Both are the same if there was no stop to end.

        Raises:
            LabError: the plant does not answer or does not end the stop, or was stopped again.
        """
        publisher, before, due = self._publisher(ESTOP_CLEAR), None, 0.0
        polls = self._polls("ended the stop")
        while True:
            heard = next(polls)
            before = before or heard
            if before is None:
                continue
            if heard is not None and heard.guard is not GuardMode.ESTOP:
                return before, heard
            if heard is not None and heard.stops != before.stops:
                raise LabError(
                    f"the robot was stopped again meanwhile, by {stopped_by(heard)}; that stop "
                    "stays: run `trill resume` again to end it"
                )
            if time.monotonic() >= due:
                due = time.monotonic() + CLEAR_PERIOD
                publisher.send(EstopClear(reason=reason, stops=before.stops))

    def reset(self, seed: int) -> PlantStatus:
        """Reset the plant (-1: with its next seed); return a status from after the reset.

        Raises:
            LabError: the plant does not answer, or does not reset.
        """
        publisher, count, due = self._publisher(PLANT_REQUEST), None, 0.0
        polls = self._polls("shown a reset (a paused plant shows none until it goes on)")
        while True:
            heard = next(polls)
            if self.state is not None and count is None:
                count = self.state.reset_count
            if count is None or self.state is None:
                continue
            if self.state.reset_count == count:
                if time.monotonic() >= due:
                    due = time.monotonic() + RESET_PERIOD
                    publisher.send(PlantRequest(action=PlantAction.RESET, seed=seed))
            elif heard is not None:
                return heard

    def _publisher(self, topic: Topic[Any]) -> Publisher[Any]:
        return Publisher(self._session, self._bus.robot, topic, self._name, self._boot)

    def _polls(self, done: str) -> Iterator[PlantStatus | None]:
        """Yield again and again the status that has come since the last time, or None.

        Raises:
            LabError: the time is over.
        """
        end = time.monotonic() + TIMEOUT
        while time.monotonic() < end:
            samples = self._tap.drain()
            self.state = self._newest(samples, PLANT_STATE) or self.state
            heard = self._newest(samples, PLANT_STATUS)
            self.status = heard or self.status
            yield heard
            time.sleep(POLL_PERIOD)
        if self.status is None:
            raise LabError(
                f"no plant of {self._bus.robot} was heard within {TIMEOUT:g} s, so none has "
                f"{done}; looked {_place(self._bus, self._name)}; if it runs elsewhere, say so "
                "with --base-port, --connect or --robot"
            )
        raise LabError(
            f"the plant of {self._bus.robot} is heard, guard {self.status.guard.name}, but has not "
            f"{done} within {TIMEOUT:g} s"
        )

    def _newest(self, samples: list[RawSample], topic: Topic[M]) -> M | None:
        """Return the newest message of a topic among samples; None if there is none."""
        key = subscription_of(self._bus.robot, topic)
        for sample in reversed(samples):
            if sample.key == key:
                with contextlib.suppress(SchemaError):
                    return decode(sample.payload, topic.schema, sample.tag or None)
        return None


def stopped_by(status: PlantStatus) -> str:
    """Return who stopped the robot, and why, in words."""
    reason = f": {status.stop_reason}" if status.stop_reason else ""
    return f"{status.stopped_by or 'somebody'}{reason}"


def _place(bus: BusConfig, name: str) -> str:
    """Return where a session looks for the plant, in words."""
    return f"at {', '.join(bus.connect_endpoints(name))}"
