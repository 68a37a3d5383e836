"""A study's directory.

study.json        the plan: what every trial has in common
trials.jsonl      a line a trial of the synthetic operator, appended when it has ended
human.jsonl       a line a trial of a person
tlx/              answer sheets
trials.csv, summary.csv, summary.json, latency.png      made from these
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.files import exclusive_lock, write_whole
from lab.errors import LatencyStudyError
from lab.studies.latency.plan import Plan
from lab.studies.latency.row import TrialRow
from lab.trials.results import JsonLines

PLAN, TRIALS, HUMAN, SHEETS = "study.json", "trials.jsonl", "human.jsonl", "tlx"
_LOCK = ".lock"


class Store:
    """A study on disk.

    Attributes:
        root: its directory.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def plan(self) -> Plan:
        """What the study consists of.

        Raises:
            LatencyStudyError: there is none here, or its file is wrong.
        """
        plan = self._plan()
        if plan is None:
            raise LatencyStudyError(
                f"no study in {self.root}: expected {PLAN} there; begin one with: trill study "
                f"latency --out {self.root}"
            )
        return plan

    @contextmanager
    def writing(self, plan: Plan) -> Iterator[None]:
        """Be the only one that runs trials here; begin the study, or go on with it.

        Raises:
            ConfigError: it was begun with other settings.
            LatencyStudyError: somebody else runs trials here, or it is no place to write.
        """
        with ExitStack() as stack:
            with self._disk():
                self.root.mkdir(parents=True, exist_ok=True)
                stack.enter_context(exclusive_lock(self.root / _LOCK, LatencyStudyError))
            known = self._plan()
            # Labels are no difference: they are of the figure alone.
            if known is not None and (differences := known.differences(plan)):
                told = "\n  ".join(differences)
                raise ConfigError(
                    f"{self.root} was begun with other settings; go on with the same, or choose "
                    f"another --out. There | asked for:\n  {told}"
                )
            if known is None:
                text = json.dumps(plan.model_dump(mode="json"), indent=1) + "\n"
                with self._disk():
                    write_whole(self.root / PLAN, text.encode())
            yield

    def rows(self) -> list[TrialRow]:
        """Trials of the synthetic operator, as they ended.

        Raises:
            LabError: a line is wrong; a torn last line is passed over.
        """
        return self._file(TRIALS).read()

    def human_rows(self) -> list[TrialRow]:
        """Trials of persons.

        Raises:
            LabError: as for :meth:`rows`.
        """
        return self._file(HUMAN).read()

    def add(self, row: TrialRow) -> None:
        """Keep a trial, whatever happens after.

        Raises:
            LabError: it cannot be written.
        """
        self._file(TRIALS if row.operator == "synthetic" else HUMAN).append(row)

    def _file(self, name: str) -> JsonLines[TrialRow]:
        return JsonLines(self.root / name, TrialRow)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """What the disk refuses, in words."""
        try:
            yield
        except OSError as error:
            raise LatencyStudyError(
                f"cannot write in {self.root}: {error.strerror}; choose another --out"
            ) from error

    def _plan(self) -> Plan | None:
        path = self.root / PLAN
        try:
            return Plan.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            return None
        except OSError as error:
            raise LatencyStudyError(f"cannot read {path}: {error.strerror}") from error
        except ValidationError as error:
            raise LatencyStudyError(f"{path}: {explain(error)}") from error
