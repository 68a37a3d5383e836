"""Many trials, several at a time, kept one by one: what is there already is not run again."""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from common.errors import ConfigError, TrillError, explain
from common.files import append_line
from common.topics import TELEOP_SETPOINT
from lab.trials.provenance import PHYSICS, digest, package_versions
from lab.trials.stack import TaskStack, TrialResult, TrialSpec
from lab.trials.workers import Workers, stop_wanted

_TICK = 0.5
"""News of the workers are looked at this often [s]."""
_SOURCE = "lab.trials.stack"
"""All that decides what a trial comes to is imported from here."""
_BEGINNING = b'{"operator": "synthetic", "code": '
"""Of every line."""
_RESULT = TypeAdapter(TrialResult)

Done = Callable[[TrialResult], None]


class TrialStoppedError(TrillError):
    """A trial was given up because its study ends."""


class ResultStore:
    """The file of a campaign: a JSON line a trial, with all it depends on.

    Attributes:
        path: where; None: nothing is kept.
        results: of the trials in it that this very code and these packages ran, by their settings.
        strange: how many in it were run by others.
    """

    def __init__(self, path: Path | None) -> None:
        """Read what is there, but for a last line that is torn or just being written.

        Raises:
            ConfigError: it is no such file; it is left as it is.
        """
        self.path = path
        self.results: dict[str, TrialResult] = {}
        self.strange = 0
        self._code = {"source": digest(_SOURCE)} | package_versions(PHYSICS)
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            content = path.read_bytes() if path.exists() else b""
            whole, _, torn = content.rpartition(b"\n")
            lines = whole.decode(errors="replace").splitlines()
            for number, one in enumerate(lines, start=1):
                self._read(one, f"{path}, line {number}")
            if not torn.startswith(_BEGINNING[: len(torn)]):
                # Not ours: to take it for torn would destroy it.
                self._read(torn.decode(errors="replace"), f"{path}, last line")
        except OSError as error:
            raise ConfigError(f"--out: cannot use {path}: {error.strerror}") from error

    def _read(self, text: str, where: str) -> None:
        try:
            entry = json.loads(text)
            result = _RESULT.validate_python(entry["result"])
            code, spec = entry["code"], entry["spec"]
        except ValidationError as error:
            raise ConfigError(f"{where}: {explain(error)}") from error
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(
                f"{where}: expected a trial written by this command, got {text[:60]!r}; choose "
                "another --out"
            ) from error
        if code == self._code:
            self.results[_key(spec)] = result
        else:
            self.strange += 1

    def of(self, spec: TrialSpec) -> TrialResult | None:
        """What became of this trial, if it was run before."""
        return self.results.get(_key(_plain(spec)))

    def add(self, spec: TrialSpec, result: TrialResult) -> None:
        """Keep a trial; on the disk when this returns.

        Raises:
            TrillError: it cannot be written.
        """
        self.results[_key(_plain(spec))] = result
        if self.path is None:
            return
        entry = {
            "operator": "synthetic",
            "code": self._code,
            "spec": _plain(spec),
            "result": asdict(result),
        }
        try:
            append_line(self.path, json.dumps(entry))
        except OSError as error:
            raise TrillError(
                f"cannot write {self.path}: {error.strerror}; what was there is kept: mend it and "
                "give the same command again"
            ) from error


def _plain(spec: TrialSpec) -> dict[str, Any]:
    values: dict[str, Any] = TypeAdapter(TrialSpec).dump_python(spec, mode="json")
    return values


def _key(spec: Mapping[str, Any]) -> str:
    return json.dumps(spec, sort_keys=True)


def run_watched(spec: TrialSpec) -> TrialResult:
    """Run one trial in a worker, and give it up when the worker is to end.

    Raises:
        TrialStoppedError: an end is wanted meanwhile.
    """
    stack = TaskStack(spec)

    def look(_setpoint: object) -> None:
        if stop_wanted():
            raise TrialStoppedError("the trial was given up")

    stack.runner.on_message(TELEOP_SETPOINT, look)
    try:
        return stack.run()
    finally:
        stack.runner.close()


def run_campaign(
    trials: Sequence[TrialSpec],
    kept: ResultStore,
    jobs: int,
    tell: Done = lambda _result: None,
    say: Callable[[str], None] = lambda _text: None,
) -> list[TrialResult]:
    """Run every trial that is not kept yet; the results are in the order of the trials.

    Args:
        trials: what is wanted.
        kept: what is there, and where new ones go.
        jobs: trials at a time.
        tell: hears of each trial that has just ended.
        say: hears what a person should know of the workers.

    Raises:
        TrillError: a trial failed other than by its judge's verdict, or its worker was lost.
    """
    missing = [trial for trial in trials if kept.of(trial) is None]
    waiting = iter(missing)
    workers = Workers(max(1, min(jobs, len(missing))))
    under_way: dict[Future[TrialResult], TrialSpec] = {}
    try:
        while True:
            while len(under_way) < workers.size and (trial := next(waiting, None)) is not None:
                under_way[workers.submit(run_watched, trial)] = trial
            if not under_way:
                break
            ended, _ = wait(under_way, timeout=_TICK, return_when=FIRST_COMPLETED)
            for future in ended:
                trial = under_way.pop(future)
                result = _result(future, trial, workers.lost)
                kept.add(trial, result)
                tell(result)
            for text in workers.watch():
                say(text)
    finally:
        workers.end()
    found = (kept.of(trial) for trial in trials)
    return [result for result in found if result is not None]


def _result(
    future: "Future[TrialResult]", trial: TrialSpec, lost: tuple[type[Exception], ...]
) -> TrialResult:
    try:
        return future.result()
    except lost as error:
        raise TrillError(
            f"the worker that ran {trial.task} with seed {trial.seed} was lost ({error}); with "
            "--out, what is done is kept: give the same command again"
        ) from error
