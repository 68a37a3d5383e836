"""Asks a bus which robot is there, and what its services publish."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from common.transport.schema_query import Description, discover
from services.logger.errors import LoggerError

TIMEOUT_S = 10.0
_PERIOD_S = 0.5


def find_robot(
    session: Any,
    where: str,
    timeout: float = TIMEOUT_S,
    stopping: Callable[[], bool] = lambda: False,
) -> str:
    """Return the name of the one robot that answers on ``session``, within ``timeout`` [s].

    The error names ``where``, the address; ``stopping`` ends the attempts when it returns True.

    Raises:
        LoggerError: no robot answers, or several do.
    """
    give_up = time.monotonic() + timeout
    found = discover(session)
    while not found and time.monotonic() < give_up and not stopping():
        time.sleep(_PERIOD_S)
        found = discover(session)
    if found:
        # A second robot may answer a moment later than the first.
        time.sleep(_PERIOD_S)
        found |= discover(session)
    if not found:
        raise LoggerError(
            f"no robot answers at {where}; expected a running system there (trill up). "
            "--robot NAME records without asking"
        )
    if len(found) > 1:
        raise LoggerError(
            f"{len(found)} robots answer at {where}: {', '.join(sorted(found))}; choose one "
            "with --robot"
        )
    return next(iter(found))


def descriptions_of(session: Any, robot: str, timeout: float = 1.0) -> Mapping[str, Description]:
    """Return the descriptions of what the services of ``robot`` publish, by key."""
    return discover(session, robot, timeout).get(robot, {})
