"""Runs what is missing of a study, several trials at a time."""

from collections import Counter, defaultdict, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from statistics import fmean
from typing import Protocol

from lab.errors import LatencyStudyError
from lab.studies.latency.plan import Cell, Plan
from lab.studies.latency.row import TrialRow
from lab.studies.latency.store import Store
from lab.studies.latency.trial import run_cell

_TRIES = 3
"""A trial that has cost so many workers is not begun again."""
_TICK = 0.5
"""The progress moves this often at least [s]."""


class Executor(Protocol):
    """Runs trials at the same time, as :class:`lab.trials.workers.Workers` does."""

    size: int
    lost: tuple[type[Exception], ...]

    def submit(
        self, work: Callable[[Plan, Cell], TrialRow], plan: Plan, cell: Cell, /
    ) -> "Future[TrialRow]":
        """Begin one."""
        ...

    def watch(self) -> list[str]:
        """Look after the workers, about twice a second; returns what a person should hear."""
        ...

    def end(self) -> None:
        """Give up what is under way."""
        ...


@dataclass
class Standing:
    """How far the study is.

    Attributes:
        wanted: trials in all.
        jobs: trials at a time.
        todo: those missing, in the order in which they are run.
        done: those that are there.
        resumed: how many of them were there before.
    """

    wanted: int
    jobs: int
    todo: list[Cell]
    done: dict[Cell, TrialRow] = field(default_factory=dict)
    resumed: int = 0

    @property
    def left(self) -> float | None:
        """Time it will still take [s], from the trials so far; None: no telling yet."""
        walls: dict[tuple[str, str], list[float]] = defaultdict(list)
        for cell, row in self.done.items():
            walls[cell.task, cell.condition].append(row.wall)
        if not walls:
            return None
        usual = fmean(row.wall for row in self.done.values())
        missing = [cell for cell in self.todo if cell not in self.done]
        each = (fmean(walls.get((cell.task, cell.condition), [usual])) for cell in missing)
        return sum(each) / min(self.jobs, max(1, len(missing)))


Listener = Callable[[Standing, TrialRow | None], None]
"""Told after each trial, and from time to time without one."""


def run_study(
    plan: Plan,
    store: Store,
    crew: Callable[[], Executor],
    *,
    episodes: int,
    jobs: int,
    tell: Listener = lambda _standing, _row: None,
    say: Callable[[str], None] = lambda _text: None,
) -> Standing:
    """Run every trial that is not in ``store`` yet.

    Args:
        plan: of the study.
        store: where the trials are kept.
        crew: makes the workers; called only if there is something to do.
        episodes: seeds in each condition of each task.
        jobs: trials at a time, for the time left.
        tell: hears of each trial.
        say: hears of workers that are lost or give no sign.

    Raises:
        LatencyStudyError: a trial has cost several workers, or the store cannot be used.
        ConfigError: the store was begun with other settings.
    """
    with store.writing(plan):
        cells = list(plan.cells(episodes))
        known = {Cell(row.seed, row.task, row.condition): row for row in store.rows()}
        there = {cell: known[cell] for cell in cells if cell in known}
        todo = [cell for cell in cells if cell not in there]
        standing = Standing(len(cells), jobs, todo, there, len(there))
        tell(standing, None)
        if todo:
            workers = crew()
            try:
                _drive(plan, standing, store, workers, tell, say)
            finally:
                workers.end()
    return standing


def _drive(
    plan: Plan,
    standing: Standing,
    store: Store,
    crew: Executor,
    tell: Listener,
    say: Callable[[str], None],
) -> None:
    """Keep the workers busy until there is nothing more to do."""
    waiting = deque(standing.todo)
    lost: Counter[Cell] = Counter()
    under_way: dict[Future[TrialRow], Cell] = {}
    while waiting or under_way:
        while waiting and len(under_way) < crew.size:
            cell = waiting.popleft()
            under_way[crew.submit(run_cell, plan, cell)] = cell
        ended, _ = wait(under_way, timeout=_TICK, return_when=FIRST_COMPLETED)
        for future in ended:
            cell = under_way.pop(future)
            try:
                row = future.result()
            except crew.lost as error:
                lost[cell] += 1
                _check_tries(cell, lost[cell], error)
                say(f"the worker that ran {cell.task} with seed {cell.seed} was lost; run again")
                waiting.appendleft(cell)
                continue
            store.add(row)
            standing.done[cell] = row
            tell(standing, row)
        for news in crew.watch():
            say(news)
        if not ended:
            tell(standing, None)


def _check_tries(cell: Cell, tries: int, error: Exception) -> None:
    if tries >= _TRIES:
        raise LatencyStudyError(
            f"{cell.task} with seed {cell.seed} has cost {tries} workers ({error}); what is done "
            "is kept: give the same command again, if memory was short with fewer --jobs"
        ) from error
