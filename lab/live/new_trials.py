"""Begin a new trial for each new operator of a system that runs a scored task.

The clock of a task starts as soon as the robot stands, so an operator that is started by hand
would come too late for its trial. Time without an operator belongs to no trial.
"""

from typing import Any, Final

from common.ports import OPERATORS
from common.schemas import PlantAction, PlantRequest, TaskStatus, TaskVerdict
from common.topics import PLANT_REQUEST
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id
from lab.monitor.bus_stats import Snapshot

SOURCE: Final = "up"
"""Source of the resets; see :func:`preceded_first_operator`."""
GRACE_TIME: Final = 1.0
"""An operator that comes this early in a trial takes part in it [s]."""


def preceded_first_operator(request: PlantRequest, trial: TaskStatus) -> bool:
    """Return whether ``request`` ends a ``trial`` that passed before the first operator came.

    The first operator gets the seed of that trial again; each further one gets another seed.
    """
    return request.header.source == SOURCE and request.seed == trial.seed


class OperatorArrivals:
    """Notices new operators and chooses the seeds of their trials. Pure."""

    def __init__(self) -> None:
        self._known: set[tuple[str, int]] = set()
        self._trials = 0

    def new_seed(self, view: Snapshot) -> int | None:
        """Return the seed of the trial to begin now; None if no new operator needs one.

        The first operator gets the seed that the plant was started with, each further one the
        next. An operator that joins others goes on with their trial.
        """
        if view.task is None:
            return None
        present = {
            (row.health.service, row.health.header.boot)
            for row in view.services
            if row.health.service in OPERATORS and row.alive
        }
        new, self._known = present - self._known, self._known | present
        if not new or len(present) > len(new):
            return None
        task, number = view.task, self._trials
        self._trials += 1
        if task.verdict is TaskVerdict.RUNNING and task.time < GRACE_TIME:
            return None
        return task.seed + (1 if number else 0)


class TrialStarter:
    """Resets the plant for new operators."""

    def __init__(self, session: Any, robot: str) -> None:
        """Publish on ``session`` as :data:`SOURCE`."""
        self._publisher = Publisher(session, robot, PLANT_REQUEST, SOURCE, new_boot_id())
        self._arrivals = OperatorArrivals()

    def update(self, view: Snapshot) -> str:
        """Begin a new trial if a new operator came; return a message about it, or an empty text."""
        seed = self._arrivals.new_seed(view)
        if seed is None:
            return ""
        self._publisher.send(PlantRequest(action=PlantAction.RESET, seed=seed))
        return f"a new operator came: a new trial begins, seed {seed}"
