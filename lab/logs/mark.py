"""Marks episodes in a running recording and waits until every recorder has the mark."""

import time
from collections.abc import Callable
from typing import Any

from common.schemas import EpisodeAction, EpisodeMark
from common.topics import EPISODE
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id, open_session
from lab.errors import LabError
from services.logger.record.attach import find_robot
from services.logger.record.episode_queries import EpisodeQueryState, ask

SERVICE = "mark"
TIMEOUT_S = 8.0
_AGAIN_S = 0.1
_RESEND_S = 1.0


def mark(bus: BusConfig, action: EpisodeAction, label: str = "") -> str:
    """Mark the start or end of an episode on ``bus``; return a sentence about what happened.

    A start gets the number after the highest that any recorder of the robot has seen; ``end`` and
    ``discard`` apply to the running episode. The mark is repeated until every recorder has it; a
    repeated mark changes nothing.

    Raises:
        BusError: the bus cannot be opened.
        LoggerError: no robot is found, or several.
        LabError: no recorder answers, no episode is running, or a recorder lacks the mark.
    """
    session: Any = open_session(bus, SERVICE)
    try:
        robot = bus.robot
        if bus.mode == "client" and "robot" not in bus.model_fields_set:
            robot = find_robot(session, ", ".join(bus.connect_endpoints(SERVICE)))
        states = _recorders(session, robot)
        number, text = _next_mark(states, action, label)
        publisher = Publisher(session, robot, EPISODE, SERVICE, new_boot_id())
        _send(
            lambda: publisher.send(EpisodeMark(episode=number, action=action, label=label)),
            lambda: _lacking(ask(session, robot), states, action, number),
        )
    finally:
        session.close()
    where = ", ".join(state.path for state in states)
    return f"{text} in {where}"


def _recorders(session: Any, robot: str) -> list[EpisodeQueryState]:
    give_up = time.monotonic() + TIMEOUT_S
    while True:
        states = ask(session, robot)
        if states:
            return states
        if time.monotonic() >= give_up:
            raise LabError(
                f"no recorder of {robot} answers, so the mark would be lost; start one with "
                "`trill record` (or `trill up`), or say where it is with --base-port or --connect"
            )
        time.sleep(_AGAIN_S)


def _next_mark(
    states: list[EpisodeQueryState], action: EpisodeAction, label: str
) -> tuple[int, str]:
    """Return the number of the marked episode and a description of what the mark does."""
    running = [(s.open_number, s.open_label) for s in states if s.open_number is not None]
    named = f" ({label})" if label else ""
    if action is EpisodeAction.START:
        number = max(state.next_number for state in states)
        cut = f"; episode {max(running)[0]} was still running and is interrupted" if running else ""
        return number, f"episode {number} started{named}{cut}"
    if not running:
        raise LabError("no episode is running; `trill mark start` begins one")
    number, old_label = max(running)
    done = "ended" if action is EpisodeAction.END else "discarded"
    return number, f"episode {number} {done}{named or (f' ({old_label})' if old_label else '')}"


def _lacking(
    now: list[EpisodeQueryState],
    before: list[EpisodeQueryState],
    action: EpisodeAction,
    number: int,
) -> list[str]:
    """Return the paths of the recorders that do not have the mark yet."""
    starts = action is EpisodeAction.START
    done = {s.path for s in now if (s.open_number == number) is starts}
    return sorted({state.path for state in before} - done)


def _send(send: Callable[[], object], lacking: Callable[[], list[str]]) -> None:
    """Send the mark until no recorder lacks it."""
    give_up = time.monotonic() + TIMEOUT_S
    resend_at = 0.0
    while missing := lacking():
        now = time.monotonic()
        if now >= give_up:
            raise LabError(
                f"the mark was sent but not recorded in {', '.join(missing)}; is that recorder "
                "still running, and does it record the topic 'episode'?"
            )
        if now >= resend_at:
            send()
            resend_at = now + _RESEND_S
        time.sleep(_AGAIN_S)
