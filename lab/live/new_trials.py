"""Begin a new trial for each new operator of a system that runs a scored task.

The clock of a task starts as soon as the robot stands, so an operator that is started by hand
would come too late for its trial. Time without an operator belongs to no trial.
"""

import time
from typing import Any, Final, NamedTuple

from common.ports import OPERATORS
from common.schemas import GuardMode, PlantAction, PlantRequest, Sender, TaskStatus, TaskVerdict
from common.topics import PLANT_REQUEST
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id
from lab.monitor.bus_stats import Snapshot

SOURCE: Final = "up"
"""Source of the resets; see :func:`preceded_first_operator`."""
GRACE_TIME: Final = 1.0
"""An operator that comes this early in a trial takes part in it [s]."""
REJOIN_TIME: Final = 5.0
"""An operator that is back within this time has crashed and goes on with its trial [s]."""


def preceded_first_operator(request: PlantRequest, trial: TaskStatus) -> bool:
    """Return whether ``request`` ends a ``trial`` that passed before the first operator came.

    The first operator gets the seed of that trial again; each further one gets another seed.
    """
    return request.header.source == SOURCE and request.seed == trial.seed


class Arrival(NamedTuple):
    """What the arrival of an operator leads to.

    Attributes:
        text: for people; empty: nothing to say.
        seed: of the trial to begin; None: none begins.
    """

    text: str = ""
    seed: int | None = None


class OperatorArrivals:
    """Notices new operators and decides about their trials. Pure."""

    def __init__(self) -> None:
        self._known: set[Sender] = set()
        self._seen: dict[str, tuple[float, int]] = {}
        """When an operator was last alive, and its boot id, by name."""
        self._finished: set[int] = set()
        self._trials = 0

    def decide(self, view: Snapshot, now: float) -> Arrival:
        """Return what the operators that came since the last call lead to; ``now`` is in [s].

        The first operator gets the seed that the plant was started with, each further one the
        next. An operator that joins others goes on with their trial, and so does one that is back
        soon after it vanished in the middle of it, as after a crash. A stopped robot is not reset.
        """
        if view.task is None:
            return Arrival()
        if view.operator is not None and view.operator.finished:
            self._finished.add(view.operator.header.boot)
        present = {
            Sender(row.health.service, row.health.header.boot)
            for row in view.services
            if row.health.service in OPERATORS and row.alive
        }
        new, self._known = present - self._known, self._known | present
        back = [operator.source for operator in new if self._is_back(operator, view.task, now)]
        self._seen |= {operator.source: (now, operator.boot) for operator in present}
        if not new or len(present) > len(new):
            return Arrival()
        if back:
            return Arrival(f"{back[0]} is back: the trial goes on; `trill reset` begins a new one")
        task, number = view.task, self._trials
        if view.plant is not None and view.plant.guard is GuardMode.ESTOP:
            return Arrival(
                f"a new operator came, but the robot is stopped by {view.plant.stopped_by}: no new "
                "trial begins; `trill resume` ends the stop, then start the operator again"
            )
        self._trials += 1
        if task.verdict is TaskVerdict.RUNNING and task.time < GRACE_TIME:
            return Arrival()
        seed = task.seed + (1 if number else 0)
        return Arrival(f"a new operator came: a new trial begins, seed {seed}", seed)

    def _is_back(self, operator: Sender, task: TaskStatus, now: float) -> bool:
        """Return whether an operator of this name vanished just now, in the middle of a trial."""
        if operator.source not in self._seen or task.verdict is not TaskVerdict.RUNNING:
            return False
        at, boot = self._seen[operator.source]
        return now - at < REJOIN_TIME and boot not in self._finished


class TrialStarter:
    """Resets the plant for new operators."""

    def __init__(self, session: Any, robot: str) -> None:
        """Publish on ``session`` as :data:`SOURCE`."""
        self._publisher = Publisher(session, robot, PLANT_REQUEST, SOURCE, new_boot_id())
        self._arrivals = OperatorArrivals()

    def update(self, view: Snapshot) -> str:
        """Begin a new trial if a new operator came; return a message about it, or an empty text."""
        arrival = self._arrivals.decide(view, time.monotonic())
        if arrival.seed is not None:
            self._publisher.send(PlantRequest(action=PlantAction.RESET, seed=arrival.seed))
        return arrival.text
