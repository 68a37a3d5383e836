"""The loop: seeds are handed out in order until there are as many successes as wanted.

The set of trials does not depend on who is how fast. A seed is handed out only while the successes
below it and the trials under way together are fewer than wanted; so the last trial of the finished
set is the one that brought the last success, whatever the number of workers, however often the run
was cut off, and whatever was lost in between.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from itertools import chain, count

from common.errors import TrillError
from studies.collect.crew import Crew
from studies.collect.episode import Made
from studies.collect.errors import CollectError
from studies.collect.recipe import Recipe
from studies.collect.store import IndexLine, Store

_TICK = 0.5
"""The progress moves this often at least [s]."""


@dataclass
class Standing:
    """How far it is.

    Attributes:
        wanted: successes.
        lines: trials done, by seed.
        resumed: how many of them were there before.
        simulated: robot time run by this process's workers [s].
        busy: time they took [s].
        rendering: of which for pictures [s].
    """

    wanted: int
    lines: dict[int, IndexLine] = field(default_factory=dict)
    resumed: int = 0
    simulated: float = 0.0
    busy: float = 0.0
    rendering: float = 0.0

    @property
    def successes(self) -> int:
        """So far."""
        return sum(line.meta.success for line in self.lines.values())

    def successes_below(self, seed: int) -> int:
        """Of the trials with smaller seeds."""
        return sum(line.meta.success for at, line in self.lines.items() if at < seed)

    @property
    def complete(self) -> bool:
        """Whether there are enough."""
        return self.successes >= self.wanted


Listener = Callable[[Standing, IndexLine | None], None]
"""Told after each trial, and from time to time without one."""


def collect(
    recipe: Recipe,
    store: Store,
    crew: Callable[[], Crew],
    *,
    wanted: int,
    first_seed: int = 0,
    max_trials: int | None = None,
    tell: Listener = lambda _standing, _line: None,
) -> Standing:
    """Collect until there are ``wanted`` successes in ``store``.

    Args:
        recipe: of the episodes.
        store: where to keep them; what is there already is not made again.
        crew: makes the workers; called only if there is something to do.
        wanted: successes in all.
        first_seed: of the first trial.
        max_trials: give up after so many; None: never.
        tell: hears of each trial.

    Returns:
        how it stands; not complete if ``max_trials`` were not enough.

    Raises:
        CollectError: a worker died, or the store cannot be used.
        ConfigError: the store was begun with another recipe.
    """
    with store.writing(recipe):
        lines = store.scan()
        strange = [line.meta.seed for line in lines if line.meta.seed < first_seed]
        if strange:
            raise CollectError(
                f"{store.root} has trials with seeds from {strange[0]} on, before --seed "
                f"{first_seed}; go on with the seed it was begun with, or choose another --out"
            )
        lines_before = frozenset(line.meta.seed for line in lines)
        standing = Standing(wanted, {line.meta.seed: line for line in lines}, len(lines))
        # What a killed run has left may lack lines, or have a torn one.
        store.write_index(lines)
        tell(standing, None)
        ends = range(first_seed, first_seed + max_trials) if max_trials else count(first_seed)
        todo = (seed for seed in ends if seed not in lines_before)
        first = next(todo, None)
        if first is not None and standing.successes_below(first) < wanted:
            workers = crew()
            try:
                _drive(standing, chain([first], todo), workers, store, tell)
            finally:
                workers.end()
        store.write_index([standing.lines[seed] for seed in sorted(standing.lines)])
    return standing


def _drive(
    standing: Standing,
    todo: Iterator[int],
    workers: Crew,
    store: Store,
    tell: Listener,
) -> None:
    """Keep the workers busy until there is nothing more to do."""
    under_way: dict[Future[Made], int] = {}
    seed = next(todo, None)
    while True:
        while (
            seed is not None
            and len(under_way) < workers.size
            and standing.successes_below(seed) + len(under_way) < standing.wanted
        ):
            under_way[workers.submit(seed)] = seed
            seed = next(todo, None)
        if not under_way:
            return
        done, _ = wait(under_way, timeout=_TICK, return_when=FIRST_COMPLETED)
        for future in sorted(done, key=lambda future: under_way[future]):
            made = _result(future, under_way.pop(future), workers.lost)
            line = store.add(made.meta, made.content)
            standing.lines[made.meta.seed] = line
            standing.simulated += made.simulated
            standing.busy += made.wall
            standing.rendering += made.rendering
            tell(standing, line)
        if not done:
            tell(standing, None)


def _result(future: Future[Made], seed: int, lost: tuple[type[Exception], ...]) -> Made:
    try:
        return future.result()
    except TrillError:
        raise
    except lost as error:
        raise CollectError(
            f"the worker that made the episode with seed {seed} was lost ({error}); what is done "
            "is kept: give the same command again, if memory was short with fewer --jobs"
        ) from error
