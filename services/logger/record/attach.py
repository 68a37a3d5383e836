"""Finding out what there is to record on a bus one knows nothing about."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from common.transport.schema_query import Description, discover
from services.logger.errors import LoggerError

PATIENCE_S = 10.0
_AGAIN_S = 0.5


def find_robot(
    session: Any,
    where: str,
    patience: float = PATIENCE_S,
    stopping: Callable[[], bool] = lambda: False,
) -> str:
    """The name of the one robot that answers on ``session``.

    Args:
        session: an open Zenoh session.
        where: what it is connected to, for the error.
        patience: how long nobody may answer [s].
        stopping: asked between attempts.

    Raises:
        LoggerError: none answers, or several do.
    """
    give_up = time.monotonic() + patience
    found = discover(session)
    while not found and time.monotonic() < give_up and not stopping():
        time.sleep(_AGAIN_S)
        found = discover(session)
    if found:
        # A second robot may be a moment behind the first.
        time.sleep(_AGAIN_S)
        found |= discover(session)
    if not found:
        raise LoggerError(
            f"no robot answers at {where}; expected a running system there (trill up). "
            "--robot NAME records what comes under that name without asking"
        )
    if len(found) > 1:
        raise LoggerError(
            f"{len(found)} robots answer at {where}: {', '.join(sorted(found))}; choose one "
            "with --robot"
        )
    return next(iter(found))


def descriptions_of(session: Any, robot: str, timeout: float = 1.0) -> Mapping[str, Description]:
    """What the services of ``robot`` say they publish, by key."""
    return discover(session, robot, timeout).get(robot, {})
