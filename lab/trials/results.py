"""Keeps results of trials in files of JSON lines, which survive a kill at any moment."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from common.errors import explain
from common.files import appending
from lab.errors import LabError
from lab.trials.campaign import Executor, run_campaign
from lab.trials.operators.kinds import operator_code
from lab.trials.operators.specs import OperatorSpec
from lab.trials.provenance import CodeVersion
from lab.trials.spec import TrialResult, TrialSpec

M = TypeVar("M", bound=BaseModel)

_CODE: Final = "lab.trials.stack"
"""This module imports all code that decides what a trial comes to, but for the operator's."""


def trial_code(operator: OperatorSpec) -> CodeVersion:
    """Return the version of the code that decides what trials of an operator come to."""
    return operator_code(operator, _CODE)


class JsonLines(Generic[M]):
    """A file of JSON lines, each a Pydantic model; processes may append at the same time.

    Attributes:
        path: the file; it need not exist.
    """

    def __init__(self, path: Path, model: type[M]) -> None:
        self.path = path
        self._model = model
        self._beginning = f'{{"{next(iter(model.model_fields))}":'.encode()

    def read(self) -> list[M]:
        """Return the models of all lines, but for a last line that is torn or being written.

        Raises:
            LabError: the file cannot be read, or a line is none of this file's.
        """
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise LabError(f"cannot read {self.path}: {error.strerror}") from error
        whole, _, torn = content.rpartition(b"\n")
        lines = whole.split(b"\n") if whole else []
        if not torn.startswith(self._beginning[: len(torn)]):
            # Nothing of ours: if it were taken for torn, the next line would overwrite it.
            lines.append(torn)
        return [self._parse(number, line) for number, line in enumerate(lines, start=1)]

    def append(self, model: M) -> None:
        """Append a line; it is on the disk when this returns.

        Raises:
            LabError: it cannot be written.
        """
        with self.appending() as append:
            append(model)

    @contextmanager
    def appending(self) -> Iterator[Callable[[M], None]]:
        """Yield a function that does what :meth:`append` does, while nobody else can append.

        Whoever appends only what is not there yet reads the lines in this block.

        Raises:
            LabError: the file cannot be written.
        """
        try:
            with appending(self.path) as append:
                yield lambda model: append(model.model_dump_json())
        except OSError as error:
            raise LabError(
                f"cannot write {self.path}: {error.strerror}; what was there is kept: mend it and "
                "give the same command again"
            ) from error

    def _parse(self, number: int, line: bytes) -> M:
        try:
            return self._model.model_validate_json(line)
        except ValidationError as error:
            raise LabError(
                f"{self.path}, line {number} is no result of this command: {explain(error)}; "
                "choose another file, or remove the line to have its trial run again"
            ) from error


class TrialRecord(BaseModel):
    """One line of a campaign's file: a trial, its result, and everything it depends on.

    Attributes:
        operator: kind of the operator, first in the line, for people.
        code: version of the code that ran the trial.
        spec: the trial.
        result: its result.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    operator: str
    code: CodeVersion
    spec: TrialSpec
    result: TrialResult


def read_records(path: Path) -> list[TrialRecord]:
    """Return the records of a campaign's file, by whatever code; of the same trial the last one.

    Raises:
        LabError: it cannot be read, or is no such file.
    """
    if not path.is_file():
        raise LabError(f"cannot read {path}: there is no such file")
    records = {record.spec.key: record for record in JsonLines(path, TrialRecord).read()}
    return list(records.values())


class TrialFile:
    """Keeps the results of a campaign's trials.

    Attributes:
        path: the file; None: results are kept in memory only.
        other_code: number of trials in the file that other code has run; they do not count.
    """

    def __init__(self, path: Path | None) -> None:
        """Read the results of the trials that this very code and these packages ran.

        Raises:
            LabError: the file cannot be used, or is no such file; it is left as it is.
        """
        self.path = path
        self._lines = None if path is None else JsonLines(path, TrialRecord)
        self._results: dict[str, TrialResult] = {}
        self.other_code = 0
        if self._lines is None:
            return
        try:
            self._lines.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LabError(f"cannot use {path}: {error.strerror}") from error
        for record in self._lines.read():
            if record.code.differences(trial_code(record.spec.operator)):
                self.other_code += 1
            else:
                self._results[record.spec.key] = record.result

    def result(self, spec: TrialSpec) -> TrialResult | None:
        """Return the result of a trial; None: it has not been run."""
        return self._results.get(spec.key)

    def add(self, spec: TrialSpec, result: TrialResult) -> None:
        """Keep a result; it is on the disk when this returns.

        Raises:
            LabError: it cannot be written.
        """
        self._results[spec.key] = result
        if self._lines is not None:
            operator = spec.operator
            self._lines.append(
                TrialRecord(
                    operator=operator.kind, code=trial_code(operator), spec=spec, result=result
                )
            )


def run_trial(codes: Mapping[str, CodeVersion], spec: TrialSpec) -> TrialResult:
    """Run one trial in a worker; if its simulation fails, the verdict is ``error``.

    Args:
        codes: version of the campaign's code, by kind of operator.
        spec: the trial.

    Raises:
        StoppedError: the worker is to end meanwhile.
        LabError: this process runs other code than the campaign.
    """
    codes[spec.operator.kind].check(trial_code(spec.operator))
    # Robot, controller and operator take long to import, and the workers alone need them.
    from lab.trials.stack import TaskStack
    from lab.trials.stillness import Stillness

    stack = TaskStack(spec)
    stillness = Stillness(stack)
    return stack.run_or_error().model_copy(update={"still": stillness.seconds})


def run_trials(
    specs: Sequence[TrialSpec],
    file: TrialFile,
    open_executor: Callable[[], Executor],
    *,
    on_result: Callable[[TrialSpec, TrialResult], None] = lambda _spec, _result: None,
    on_message: Callable[[str], None] = lambda _text: None,
) -> list[TrialResult]:
    """Run every trial that ``file`` lacks; returns all results in the order of ``specs``.

    Args:
        specs: the trials.
        file: keeps the results.
        open_executor: makes the workers; called only if a trial is to be run.
        on_result: called with each new trial and its result.
        on_message: called with what the user should know of the workers.

    Raises:
        TrillError: a trial could not be begun, or cost several workers.
    """

    def keep(spec: TrialSpec, result: TrialResult) -> None:
        file.add(spec, result)
        on_result(spec, result)

    missing = [spec for spec in specs if file.result(spec) is None]
    if missing:
        run_campaign(
            missing,
            partial(run_trial, {s.operator.kind: trial_code(s.operator) for s in missing}),
            open_executor(),
            on_result=keep,
            on_message=on_message,
        )
    results = (file.result(spec) for spec in specs)
    return [result for result in results if result is not None]
