"""Collects demonstrations: seeds are handed out in order until enough trials have succeeded.

The set of trials does not depend on how fast the workers are. A seed is handed out only while the
successes below it and the trials under way together are fewer than wanted. So the last trial of the
finished set is the one that brought the last success, for any number of workers and after any
interruption.
"""

from bisect import bisect_left, insort
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import chain, count
from typing import TYPE_CHECKING

from common.episodes.folder import IndexLine
from lab.demonstrations.collect.config import EpisodeConfig, collecting_code
from lab.demonstrations.collect.space import check_room, free, needed, size
from lab.demonstrations.collect.store import DatasetStore
from lab.trials.campaign import Executor, run_campaign
from lab.trials.provenance import CodeVersion

if TYPE_CHECKING:
    from lab.demonstrations.collect.episode import EpisodeResult


class CollectionProgress:
    """Progress of the collection; a trial is counted in the same time however many there are.

    Attributes:
        wanted: number of successes wanted.
        lines: trials that have been run, by seed.
        resumed: number of trials that an earlier run had left.
        bytes: size of the files of all trials.
        simulated: robot time run by the workers of this process [s].
        busy: time these workers took [s].
        rendering: time these workers took for pictures [s].
    """

    def __init__(self, wanted: int, lines: Iterable[IndexLine] = ()) -> None:
        """Begin with the trials that an earlier run had left."""
        self.wanted = wanted
        self.lines: dict[int, IndexLine] = {}
        self.bytes = 0
        self.simulated = self.busy = self.rendering = 0.0
        self._succeeded: list[int] = []
        """Seeds of the successes, in order."""
        for line in lines:
            self.add(line)
        self.resumed = len(self.lines)

    def add(self, line: IndexLine) -> None:
        """Count a trial."""
        self.lines[line.meta.seed] = line
        self.bytes += line.bytes
        if line.meta.success:
            insort(self._succeeded, line.meta.seed)

    @property
    def successes(self) -> int:
        """Number of successes so far."""
        return len(self._succeeded)

    def successes_below(self, seed: int) -> int:
        """Return the number of successes among the trials with smaller seeds."""
        return bisect_left(self._succeeded, seed)

    @property
    def complete(self) -> bool:
        """Whether there are as many successes as wanted."""
        return self.successes >= self.wanted


@dataclass(frozen=True)
class SeedKey:
    """Identifies a trial by its seed."""

    seed: int

    def __str__(self) -> str:
        return f"the trial with seed {self.seed}"


def collect(
    config: EpisodeConfig,
    store: DatasetStore,
    open_executor: Callable[[], Executor],
    *,
    wanted: int,
    first_seed: int | None = None,
    max_trials: int | None = None,
    code: CodeVersion | None = None,
    accept_changes: bool = False,
    on_progress: Callable[[CollectionProgress, IndexLine | None], None] = lambda _p, _line: None,
    on_message: Callable[[str], None] = lambda _text: None,
) -> CollectionProgress:
    """Collect until there are ``wanted`` successes in ``store``.

    Args:
        config: settings of the episodes.
        store: keeps them; what is there already is not made again.
        open_executor: makes the workers; called only if a trial is to be run.
        wanted: number of successes in all.
        first_seed: seed of the first trial; None: as it was begun, 0 for a new data set.
        max_trials: give up after this number of trials; None: never.
        code: the code that makes the episodes; None: this process's.
        accept_changes: whether to continue although other code made the episodes there.
        on_progress: called with each new trial, and about twice a second without one.
        on_message: called with what the user should know meanwhile.

    Returns:
        the progress; not complete if ``max_trials`` were not enough.

    Raises:
        LabError: a trial has cost several workers.
        EpisodeError: the store cannot be used.
        ConfigError: the store was begun with other settings or another seed, or by other code.
    """
    code = code or collecting_code(config.operator)
    check_room(store.root, needed(config, (), 0 if store.files() else wanted))
    with store.writing(config, code, accept_changes, first_seed, wanted) as begin:
        lines = store.scan()
        progress = CollectionProgress(wanted, lines)
        # The index of a run that was killed may lack lines, or have a torn one.
        store.write_index(lines)
        on_progress(progress, None)
        need = needed(config, lines, max(0, wanted - progress.successes))
        check_room(store.root, need)
        if need.total:
            on_message(
                f"{wanted - progress.successes} more successes take about {size(need.total)} "
                f"({size(need.each)} each, {'measured' if need.measured else 'estimated'}); "
                f"{size(free(store.root))} free"
            )

        kinds = {line.meta.machine for line in lines}

        def keep(key: SeedKey, result: "EpisodeResult") -> None:
            kind = result.meta.machine
            if kinds and kind not in kinds:
                on_message(
                    f"seed {key.seed} was made on another kind of processor than those before, "
                    f"{kind}: its last digits differ from theirs"
                )
            kinds.add(kind)
            line = store.add(result.meta, result.content)
            progress.add(line)
            progress.simulated += result.simulated
            progress.busy += result.wall
            progress.rendering += result.rendering
            on_progress(progress, line)

        def may_start(key: SeedKey, under_way: int) -> bool:
            return progress.successes_below(key.seed) + under_way < wanted

        there = frozenset(progress.lines)
        seeds = range(begin, begin + max_trials) if max_trials else count(begin)
        keys = (SeedKey(seed) for seed in seeds if seed not in there)
        first = next(keys, None)
        if first is not None and may_start(first, 0):
            run_campaign(
                chain([first], keys),
                partial(_make, config, code),
                open_executor(),
                on_result=keep,
                on_message=on_message,
                on_wait=lambda: on_progress(progress, None),
                may_start=may_start,
            )
        store.write_index([progress.lines[seed] for seed in sorted(progress.lines)])
    return progress


def _make(config: EpisodeConfig, code: CodeVersion, key: SeedKey) -> "EpisodeResult":
    """Make an episode in a worker, by the same code as the campaign's."""
    code.check(collecting_code(config.operator))
    # Robot, controller and operator take long to import, and the workers alone need them.
    from lab.demonstrations.collect.episode import make_episode

    return make_episode(config, key.seed)
