"""Keeps a study in a folder.

study.json        the plan: what all trials have in common
trials.jsonl      a line for each trial of the synthetic operator, appended when it has ended
human.jsonl       a line for each trial of a person
tlx/              answer sheets
trials.csv, summary.csv, workload.csv, summary.json, latency.png      the report
"""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from common.errors import ConfigError
from lab.errors import LatencyStudyError
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import StudyTrial
from lab.trials.folder import locked_folder, read_model, write_model
from lab.trials.results import JsonLines

PLAN, TRIALS, HUMAN, SHEETS = "study.json", "trials.jsonl", "human.jsonl", "tlx"


class StudyStore:
    """A study on disk.

    Attributes:
        root: its folder.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def plan(self) -> Plan:
        """Return the study's plan.

        Raises:
            LatencyStudyError: there is no study here, or its file is wrong.
        """
        plan = self._read_plan()
        if plan is None:
            raise LatencyStudyError(
                f"no study in {self.root}: expected {PLAN} there. Begin one for the trials of "
                "persons with: trill study latency --episodes 0 --out "
                f"{shlex.quote(str(self.root))}\n"
                "(--tasks and --condition choose others than the paper's; without --episodes 0 the "
                "synthetic operator does its trials first)"
            )
        return plan

    @contextmanager
    def writing(self, plan: Plan) -> Iterator[None]:
        """Begin the study, or continue it, as the only process that runs trials here.

        Raises:
            ConfigError: it was begun with other settings.
            LatencyStudyError: another process runs trials here, or the folder cannot be written.
        """
        with locked_folder(self.root, LatencyStudyError):
            known = self._read_plan()
            if known is None:
                write_model(self.root / PLAN, plan, LatencyStudyError)
            elif differences := known.differences(plan):
                lines = "\n  ".join(differences)
                raise ConfigError(
                    f"{self.root} was begun with other settings; go on with the same, or choose "
                    f"another --out. There | asked for:\n  {lines}"
                )
            yield

    def trials(self) -> list[StudyTrial]:
        """Return the trials of the synthetic operator in the order in which they ended.

        Raises:
            LabError: a line is wrong; a torn last line is ignored.
        """
        return self._file(TRIALS).read()

    def human_trials(self) -> list[StudyTrial]:
        """Return the trials of persons.

        Raises:
            LabError: as for :meth:`trials`.
        """
        return self._file(HUMAN).read()

    def add(self, trial: StudyTrial) -> None:
        """Append a trial of the synthetic operator; it is on the disk when this returns.

        Raises:
            LabError: it cannot be written.
        """
        self._file(TRIALS).append(trial)

    @contextmanager
    def adding(self) -> Iterator[Callable[[StudyTrial], None]]:
        """Yield a function that appends a person's trial, while no other process can add any.

        What is there already has to be looked up in this block.

        Raises:
            LabError: as for :meth:`add`.
        """
        with self._file(HUMAN).appending() as append:
            yield append

    def _file(self, name: str) -> JsonLines[StudyTrial]:
        return JsonLines(self.root / name, StudyTrial)

    def _read_plan(self) -> Plan | None:
        return read_model(self.root / PLAN, Plan, LatencyStudyError)
