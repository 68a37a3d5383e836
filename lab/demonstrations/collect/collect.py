"""The loop: seeds are handed out in order until there are as many successes as wanted.

The set of trials does not depend on who is how fast. A seed is handed out only while the successes
below it and the trials under way together are fewer than wanted; so the last trial of the finished
set is the one that brought the last success, whatever the number of workers, however often the run
was cut off, and whatever was lost in between.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from itertools import chain, count

from common.episodes.errors import EpisodeError
from common.errors import TrillError
from lab.demonstrations.collect.dataset import Build
from lab.demonstrations.collect.episode import EpisodeResult
from lab.demonstrations.collect.executors import Executor
from lab.demonstrations.collect.recipe import EpisodeConfig
from lab.demonstrations.collect.space import check_room, free, needed, size
from lab.demonstrations.collect.store import IndexLine, Store

_TICK = 0.5
"""The progress moves this often at least [s]."""
_TRIES = 3
"""A trial that has cost so many workers is not begun again."""


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
    recipe: EpisodeConfig,
    store: Store,
    crew: Callable[[], Executor],
    *,
    wanted: int,
    first_seed: int | None = None,
    max_trials: int | None = None,
    build: Build | None = None,
    accept_changes: bool = False,
    tell: Listener = lambda _standing, _line: None,
    say: Callable[[str], None] = lambda _text: None,
    each: Callable[[], None] = lambda: None,
) -> Standing:
    """Collect until there are ``wanted`` successes in ``store``.

    Args:
        recipe: of the episodes.
        store: where to keep them; what is there already is not made again.
        crew: makes the workers; called only if there is something to do.
        wanted: successes in all.
        first_seed: of the first trial; None: as it was begun, a new one with 0.
        max_trials: give up after so many; None: never.
        build: the code that makes them; None: this process's.
        accept_changes: go on though other code made what is there.
        tell: hears of each trial.
        say: hears what a person should know meanwhile.
        each: called after each file of before that was read.

    Returns:
        how it stands; not complete if ``max_trials`` were not enough.

    Raises:
        EpisodeError: a trial costs its worker again and again, or the store cannot be used.
        ConfigError: the store was begun with another recipe or seed, or by other code.
    """
    build = build or Build.here()
    check_room(store.root, needed(recipe, (), 0 if store.files() else wanted))
    with store.writing(recipe, build, accept_changes, first_seed) as begin:
        lines = store.scan(each)
        lines_before = frozenset(line.meta.seed for line in lines)
        standing = Standing(wanted, {line.meta.seed: line for line in lines}, len(lines))
        # What a killed run has left may lack lines, or have a torn one.
        store.write_index(lines)
        tell(standing, None)
        ends = range(begin, begin + max_trials) if max_trials else count(begin)
        todo = (seed for seed in ends if seed not in lines_before)
        first = next(todo, None)
        missing = max(0, wanted - standing.successes)
        need = needed(recipe, lines, missing)
        check_room(store.root, need)
        if missing:
            say(
                f"{missing} more successes take about {size(need.total)} "
                f"({size(need.each)} each, {'measured' if need.measured else 'guessed'}); "
                f"{size(free(store.root))} free"
            )
        if first is not None and standing.successes_below(first) < wanted:
            workers = crew()
            try:
                _Drive(standing, workers, store, build, tell, say).run(chain([first], todo))
            finally:
                workers.end()
        store.write_index([standing.lines[seed] for seed in sorted(standing.lines)])
    return standing


class _Drive:
    """Keeps the workers busy until there is nothing more to do."""

    def __init__(
        self,
        standing: Standing,
        workers: Executor,
        store: Store,
        build: Build,
        tell: Listener,
        say: Callable[[str], None],
    ) -> None:
        self._standing, self._workers, self._store = standing, workers, store
        self._build, self._tell, self._say = build, tell, say
        self._under_way: dict[Future[EpisodeResult], int] = {}
        self._lost: Counter[int] = Counter()

    def run(self, todo: Iterator[int]) -> None:
        """Hand out the seeds of ``todo`` until there are enough successes."""
        standing, under_way = self._standing, self._under_way
        seed = next(todo, None)
        while True:
            while (
                seed is not None
                and len(under_way) < self._workers.size
                and standing.successes_below(seed) + len(under_way) < standing.wanted
            ):
                under_way[self._workers.submit(seed)] = seed
                seed = next(todo, None)
            if not under_way:
                return
            done, _ = wait(under_way, timeout=_TICK, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=lambda future: under_way[future]):
                self._end_of(future, under_way.pop(future))
            for news in self._workers.watch():
                self._say(news)
            if not done:
                self._tell(standing, None)

    def _end_of(self, future: "Future[EpisodeResult]", seed: int) -> None:
        try:
            made = future.result()
        except TrillError:
            raise
        except self._workers.lost as error:
            self._again(seed, error)
            return
        self._check(made)
        line = self._store.add(made.meta, made.content)
        self._standing.lines[seed] = line
        self._standing.simulated += made.simulated
        self._standing.busy += made.wall
        self._standing.rendering += made.rendering
        self._tell(self._standing, line)

    def _again(self, seed: int, error: Exception) -> None:
        self._lost[seed] += 1
        if self._lost[seed] >= _TRIES:
            raise EpisodeError(
                f"the trial with seed {seed} has cost {_TRIES} workers ({error}); what is done is "
                "kept: give the same command again, if memory was short with fewer --jobs"
            ) from error
        self._say(
            f"the worker at seed {seed} died (killed? out of memory?); another makes it again"
        )
        self._under_way[self._workers.submit(seed)] = seed

    def _check(self, made: EpisodeResult) -> None:
        # Files edited meanwhile, or a cluster's node with another version.
        theirs = Build(source=made.meta.source, versions=made.meta.versions)
        changes = self._build.differences(theirs)
        if changes:
            raise EpisodeError(
                f"the worker that made seed {made.meta.seed} runs other code than this process; it "
                "is not kept. Bring all nodes to the same version, and edit nothing meanwhile. "
                "Here | there:\n  " + "\n  ".join(changes)
            )
