"""``trill study policies``: train and evaluate policies by a plan, and table all results."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from lab.cli import eval as evaluation
from lab.cli import train as training
from lab.cli.collect import DATASETS
from lab.cli.commands import Action
from lab.cli.eval import ROOT
from lab.cli.train import POLICIES, folder_name
from lab.learning.evaluation.paper import PAPER_TASKS
from lab.learning.plans import PLANS, SIZES, Step, steps
from lab.trials import options

OUT = Path("runs/studies/policies")
TEXT = f"""Tables and figures of all policies that were evaluated, beside the paper's: success for
each kind of policy and task, the paper's ablations, success over the number of demonstrations.
Everything comes from the files that trill eval keeps. Trials of the synthetic operator
(python -m lab.studies.tasks run ... --out FILE) may be among them.

With --run the policies are trained and evaluated first, by a plan; several may be given:
  kinds      trill, bc-rnn and bc; beside them one without eyes, and the constant mean action
  ablations  trill, and monoscopic, no-joint-state, deterministic, categorical
  sizes      trill from the first {", ".join(map(str, SIZES))} demonstrations, as far as there are
Each task needs its data set (trill collect). --show prints the commands that are run. What is
there is not done again: stopped or killed, the same command goes on."""
EXAMPLES = f"""examples:
  trill study policies                                  all files in {ROOT}
  trill study policies {ROOT} runs/operator.jsonl
  trill study policies one.jsonl other.jsonl --out report
  trill study policies --run kinds --tasks door/unlock door/walk door/push --jobs 2
  trill study policies --run ablations --run sizes --tasks door/unlock --jobs 2
  trill study policies --run kinds --train "--recipe paper --profile paper --device cuda" --show
"""


class _Command(NamedTuple):
    """A command that a plan gives.

    Attributes:
        words: after ``trill``.
        action: what it does.
        arguments: its parsed options.
    """

    words: list[str]
    action: Action
    arguments: argparse.Namespace

    def __str__(self) -> str:
        return shlex.join(["trill", *self.words])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill study policies``."""
    parser.add_argument(
        "results",
        nargs="*",
        type=Path,
        default=[ROOT],
        metavar="RESULTS",
        help=f"files of trill eval, or folders of them; --run adds to the first ({ROOT})",
    )
    parser.add_argument(
        "--out", type=Path, default=OUT, help=f"folder of the tables and figures ({OUT})"
    )
    made = parser.add_argument_group("train and evaluate first")
    made.add_argument("--run", action="append", default=[], choices=PLANS, help="the plan")
    made.add_argument(
        "--tasks", nargs="+", default=PAPER_TASKS, metavar="TASK", help="(the paper's six)"
    )
    made.add_argument(
        "--sizes",
        nargs="+",
        type=options.count,
        default=SIZES,
        metavar="N",
        help=f"of the data set ({' '.join(map(str, SIZES))})",
    )
    made.add_argument(
        "--data", type=Path, default=DATASETS, metavar="DIR", help=f"data sets ({DATASETS})"
    )
    made.add_argument(
        "--policies", type=Path, default=POLICIES, metavar="DIR", help=f"trainings ({POLICIES})"
    )
    made.add_argument("--train", default="", metavar="OPTIONS", help="of trill train, for all")
    made.add_argument("--eval", default="", metavar="OPTIONS", help="of trill eval, for all")
    made.add_argument(
        "--jobs", type=options.count, default=1, metavar="N", help="trials at a time (1)"
    )
    made.add_argument("--show", action="store_true", help="print the commands and do nothing")


def run(arguments: argparse.Namespace) -> int:
    """Run the plans, write and print the tables; returns 0 or raises one of our exceptions."""
    commands = [
        command for task, step in _steps(arguments) for command in _commands(arguments, task, step)
    ]
    if arguments.show:
        print("\n".join(map(str, commands)))
        return 0
    for number, command in enumerate(commands, start=1):
        print(f"[{number}/{len(commands)}] {command}", file=sys.stderr)
        command.action.run(command.arguments)
    return _report(arguments.results, arguments.out)


def _steps(arguments: argparse.Namespace) -> list[tuple[str, Step]]:
    """Return each task with what is trained and evaluated for it.

    Raises:
        TrainingError: a task has no data set.
    """
    from lab.learning.training.demonstrations import episode_files

    found = []
    for task in arguments.tasks if arguments.run else ():
        given = _parsed(training.ACTION, ["train", task, *shlex.split(arguments.train)])
        there = len(episode_files(arguments.data / folder_name(task)))
        sizes = [size for size in arguments.sizes if size <= there]
        found += [(task, step) for step in steps(arguments.run, sizes, given.recipe)]
    return found


def _commands(arguments: argparse.Namespace, task: str, step: Step) -> tuple[_Command, _Command]:
    """Return the training and the evaluation of a policy."""
    data = str(arguments.data / folder_name(task))
    words = ["train", task, "--data", data, *step.train, *shlex.split(arguments.train)]
    name = training.training_name(_parsed(training.ACTION, words))
    out = arguments.policies / "-".join(filter(None, (name, step.variant)))
    train = [*words, "--out", str(out)]
    evaluate = ["eval", str(out / "last"), "--out", str(arguments.results[0] / f"{out.name}.jsonl")]
    evaluate += ["--jobs", str(arguments.jobs), *step.evaluate, *shlex.split(arguments.eval)]
    return (
        _Command(train, training.ACTION, _parsed(training.ACTION, train)),
        _Command(evaluate, evaluation.ACTION, _parsed(evaluation.ACTION, evaluate)),
    )


def _parsed(action: Action, words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"trill {words[0]}")
    action.add(parser)
    return parser.parse_args(words[1:])


def _report(results: Sequence[Path], out: Path) -> int:
    """Write and print tables and figures of all results."""
    from lab.errors import LabError
    from lab.learning.evaluation.comparison import comparisons, rows_of
    from lab.learning.evaluation.figure import draw_sizes, draw_success
    from lab.learning.evaluation.tables import PUBLISHED, read_results, tables_text
    from lab.trials.folder import disk_errors, write_file

    records = read_results(results)
    text, written = tables_text(records), ["policies.md"]
    with disk_errors(out, LabError):
        out.mkdir(parents=True, exist_ok=True)
        for comparison in comparisons(records):
            setting = comparison.setting or PUBLISHED
            for what in ("kinds", "ablations"):
                name = "-".join((what, *setting.replace(",", "").split())) + ".png"
                title = f"{what.capitalize()}: {setting}"
                columns = getattr(comparison, what)
                if draw_success(out / name, title, columns):
                    written.append(name)
        if draw_sizes(out / "sizes.png", rows_of(records)):
            written.append("sizes.png")
    write_file(out / "policies.md", text.encode(), LabError)
    print(text)
    print(f"{out}: {', '.join(written)}")
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
