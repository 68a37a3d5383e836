"""Query endpoint of a recorder: its running episode and the next episode number."""

from typing import Any

import msgpack
import zenoh
from pydantic import BaseModel, ConfigDict, ValidationError

from common.queries import EPISODES
from services.logger.record.recorder import Recorder


class EpisodeQueryState(BaseModel):
    """The answer of one recorder."""

    model_config = ConfigDict(frozen=True)

    path: str
    next_number: int
    open_number: int | None
    open_label: str = ""


class EpisodeQueryServer:
    """Answers queries on ``<robot>/episodes/<recorder>``."""

    def __init__(self, session: "zenoh.Session", robot: str, recorder: Recorder) -> None:
        """Begin to answer for ``recorder``."""
        key = EPISODES.key(robot, str(session.info.zid()))

        def reply(query: Any) -> None:
            with query:
                query.reply(key, msgpack.packb(state_of(recorder).model_dump()))

        self._queryable: Any = session.declare_queryable(key, reply)

    def close(self) -> None:
        """Stop answering; the session must still be open."""
        self._queryable.undeclare()


def state_of(recorder: Recorder) -> EpisodeQueryState:
    """Return the state of ``recorder``."""
    book = recorder.episodes
    running = book.open
    return EpisodeQueryState(
        path=str(recorder.path.absolute()),
        next_number=book.next_number,
        open_number=None if running is None else running.episode,
        open_label="" if running is None else running.label,
    )


def ask(session: "zenoh.Session", robot: str, timeout: float = 2.0) -> list[EpisodeQueryState]:
    """Ask all recorders of ``robot`` for their states; ignore invalid answers."""
    states = []
    for reply in session.get(
        EPISODES.key(robot, "*"),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout,
    ):
        if reply.ok is None:
            continue
        try:
            states.append(
                EpisodeQueryState.model_validate(msgpack.unpackb(reply.ok.payload.to_bytes()))
            )
        except (ValidationError, ValueError, msgpack.exceptions.UnpackException):
            continue
    return states
