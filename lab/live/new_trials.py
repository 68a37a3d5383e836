"""A new operator begins a new trial: what passed while nobody operated does not count.

The clock of a task starts when the robot stands; whoever starts an operator by hand is later.
"""

from typing import Any, Final

from common.ports import OPERATORS
from common.schemas import PlantAction, PlantRequest, TaskStatus, TaskVerdict
from common.topics import PLANT_REQUEST
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id
from lab.monitor.bus_stats import Snapshot

SOURCE: Final = "up"
"""Of the resets; see :func:`preceded_first_operator`."""
SOON: Final = 1.0
"""An operator that comes earlier in the trial is in time [s]."""


def preceded_first_operator(request: PlantRequest, trial: TaskStatus) -> bool:
    """Whether ``request`` ends a ``trial`` that passed before the first operator came.

    The first operator is given its seed once more; the trial before a further one was somebody's.
    """
    return request.header.source == SOURCE and request.seed == trial.seed


class NewTrials:
    """Notices operators as they come. Pure."""

    def __init__(self) -> None:
        self._known: set[tuple[str, int]] = set()
        self._trials = 0

    def due(self, view: Snapshot) -> int | None:
        """Seed of the trial to begin now; None: none is due.

        The first operator gets the seed the plant was started with, each further one the next.
        """
        if view.task is None:
            return None
        there = {
            (row.health.service, row.health.header.boot)
            for row in view.services
            if row.health.service in OPERATORS and row.alive
        }
        came, self._known = there - self._known, self._known | there
        if not came or len(there) > len(came):
            # One of several that takes over in the middle of a trial goes on with it.
            return None
        task, number = view.task, self._trials
        self._trials += 1
        if task.verdict is TaskVerdict.RUNNING and task.time < SOON:
            return None
        return task.seed + (1 if number else 0)


class TrialBeginner:
    """Resets the plant for new operators."""

    def __init__(self, session: Any, robot: str) -> None:
        """Publish on ``session`` as :data:`SOURCE`."""
        self._publisher = Publisher(session, robot, PLANT_REQUEST, SOURCE, new_boot_id())
        self._due = NewTrials()

    def look(self, view: Snapshot) -> str:
        """Begin a new trial if a new operator came; says so, or nothing."""
        seed = self._due.due(view)
        if seed is None:
            return ""
        self._publisher.send(PlantRequest(action=PlantAction.RESET, seed=seed))
        return f"an operator came: a new trial begins, seed {seed}"
