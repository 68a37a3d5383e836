"""The subcommands ``trill study add`` and ``trill study tlx``: trials and answers of persons."""

import argparse
import random
import re
import sys
from collections.abc import Callable, Collection
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from common.errors import ConfigError, explain
from lab.cli.commands import Action, Command
from lab.cli.log_argument import add_log_argument, chosen_log
from lab.trials import options

if TYPE_CHECKING:
    from lab.studies.latency.record import StudyTrial
    from lab.studies.latency.tlx import Answers

ROOT = Path("runs/studies/latency")
ADD = """Add a person's trials from a recorded log to the study: verdict, time and contacts as the
task's judge gave them, latencies as the services measured them, and how the hands moved. Every
judged trial of the log counts, except those before the operator came; all must have been done under
one condition. A trial is identified by participant, task, condition and seed, and added once. A log
whose latencies do not fit the condition is refused; --anyway adds it. Then write the report again:
trill study latency --report DIR."""
ADD_EXAMPLES = """examples:
  trill up --task door/unlock --seed 3 --latency command=250ms          in one terminal
  python -m services.teleop keyboard                                    in another
  trill study add runs/20260131-120000 --participant P01 --condition latency-250
"""
TLX = """Ask one person for the NASA Task Load Index in this terminal: six scales from 0 to 100 in
steps of 5, then the 15 pairs of scales in random order (--no-pairs leaves them out; only the
weighted score needs them). The answers can be given in a file instead. The sheet is written when
all questions are answered; Ctrl-C before that leaves nothing behind."""
TLX_EXAMPLES = """examples:
  trill study tlx --participant P01 --task door/unlock --condition interpolation --seeds 3 4 5
  trill study tlx --participant P01 --task door/unlock --condition raw --answers p01.json

a file of answers; `weights` (how often each scale was chosen, 15 in all) may be left out:
  {"ratings": {"mental": 55, "physical": 20, "temporal": 40, "performance": 10, "effort": 60,
   "frustration": 25}, "weights": {"mental": 5, "physical": 4, "temporal": 3, "performance": 2,
   "effort": 1, "frustration": 0}, "remarks": ""}
"""


def _add_options(add: argparse.ArgumentParser) -> None:
    add_log_argument(add)
    add.add_argument(
        "--anyway", action="store_true", help="also if measured latencies do not fit the condition"
    )
    _session_options(add)


def _tlx_options(tlx: argparse.ArgumentParser) -> None:
    tlx.add_argument("--task", required=True, help="the task that was done")
    tlx.add_argument(
        "--seeds", type=options.seed, nargs="*", default=[], help="seeds of the person's trials"
    )
    tlx.add_argument("--no-pairs", action="store_true", help="ask only for the six scales")
    tlx.add_argument("--remarks", help="remarks of the person")
    tlx.add_argument("--answers", type=Path, metavar="FILE.json", help="take the answers from FILE")
    _session_options(tlx)


def _session_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--participant", required=True, type=_pseudonym, help="pseudonym, as P01; never a name"
    )
    parser.add_argument("--condition", required=True, help="name of the condition in the study")
    parser.add_argument("--out", type=Path, default=ROOT, help=f"the study's folder ({ROOT})")


def _pseudonym(text: str) -> str:
    from lab.studies.latency.tlx import PSEUDONYM

    if not re.fullmatch(PSEUDONYM, text):
        raise argparse.ArgumentTypeError(
            f"expected letters, digits, - and _, 40 at most; got {text!r}"
        )
    return text


def _add(arguments: argparse.Namespace) -> int:
    from lab.errors import LatencyStudyError
    from lab.progress import ProgressBar
    from lab.studies.latency.human_trials import read_trials
    from lab.studies.latency.store import StudyStore
    from services.logger.read.reader import LogReader

    store = StudyStore(arguments.out)
    plan = store.plan()
    condition = plan.condition(arguments.condition)
    path = chosen_log(arguments.log)
    with ProgressBar("reading the log") as bar:
        trials = read_trials(LogReader(path), arguments.participant, condition, bar.advance)
    with store.adding() as add:
        known = {trial.key for trial in store.human_trials()}
        # All trials are checked first: a log that is added in part looks like a complete one.
        for trial in trials:
            if trial.task not in plan.tasks:
                raise LatencyStudyError(
                    f"{path}: {trial.task} is not in the study {store.root}; expected one of "
                    f"{', '.join(plan.tasks)}; nothing was added"
                )
            if not arguments.anyway and trial.key not in known:
                _check_latencies(path, trial)
        for trial in trials:
            text = f"{trial.task} {trial.condition} seed {trial.seed}, {trial.participant}"
            if trial.key in known:
                print(f"{text}: there already, left as it is")
                continue
            known.add(trial.key)
            add(trial)
            print(f"{text}: {_measured(trial)}")
    return 0


def _measured(trial: "StudyTrial") -> str:
    asked, mean = trial.command.asked_mean, trial.command.mean
    return (
        f"{trial.verdict} at {trial.time:.1f} s; command latency: requested {1e3 * asked:.0f} ms, "
        f"measured {'nothing' if mean is None else f'{1e3 * mean:.0f} ms'}"
    )


def _check_latencies(path: Path, trial: "StudyTrial") -> None:
    from lab.errors import LatencyStudyError
    from lab.studies.latency.record import OWN_LATENCY

    for name, own in OWN_LATENCY.items():
        link = getattr(trial, name)
        if not link.agrees(own):
            raise LatencyStudyError(
                f"{path}: {trial.task} seed {trial.seed}: condition {trial.condition} asks for "
                f"{1e3 * link.asked_mean:.0f} ms of {name} latency, measured were "
                f"{1e3 * link.mean:.0f} ms; is it the log of another condition? Nothing was added; "
                "--anyway adds it all the same"
            )


def _tlx(arguments: argparse.Namespace) -> int:
    from lab.studies.latency.store import SHEETS, StudyStore
    from lab.studies.latency.tlx import AnswerSheet, write_sheet

    store = StudyStore(arguments.out)
    plan = store.plan()
    plan.condition(arguments.condition)
    if arguments.task not in plan.tasks:
        raise ConfigError(
            f"--task: {arguments.task!r} is not in the study; expected {' or '.join(plan.tasks)}"
        )
    if arguments.answers is not None:
        answers = _read_answers(arguments.answers)
    elif sys.stdin.isatty():
        answers = ask(input, random.SystemRandom(), pairs=not arguments.no_pairs)
    else:
        raise ConfigError("the input is no terminal; expected --answers FILE.json")
    sheet = AnswerSheet(
        participant=arguments.participant,
        task=arguments.task,
        condition=arguments.condition,
        seeds=arguments.seeds,
        date=datetime.now().astimezone().replace(microsecond=0),
        **answers.model_dump() | ({"remarks": arguments.remarks} if arguments.remarks else {}),
    )
    path = write_sheet(store.root / SHEETS, sheet)
    weighted = sheet.weighted_score
    scores = f"raw score {sheet.raw_score:.1f}"
    print(scores if weighted is None else f"{scores}, weighted {weighted:.1f}")
    print(path)
    return 0


def _read_answers(path: Path) -> "Answers":
    from lab.studies.latency.tlx import Answers

    try:
        return Answers.model_validate_json(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except ValidationError as error:
        raise ConfigError(f"{path}: nothing was written:\n{explain(error)}") from error


def ask(read: Callable[[str], str], rng: random.Random, *, pairs: bool) -> "Answers":
    """Ask for the scales and, if wanted, for the pairs; a wrong answer is asked for again.

    Args:
        read: shows a prompt and returns what was typed, like :func:`input`.
        rng: decides the order of the pairs and of the scales in each pair.
        pairs: whether to ask for the pairs.

    Raises:
        ConfigError: the input ended before all questions were answered.
    """
    from lab.studies.latency.tlx import PAIRS, SCALES, STEP, Answers

    steps = [str(step) for step in range(0, 101, STEP)]
    weights = dict.fromkeys(SCALES, 0) if pairs else None
    try:
        print(f"Six scales, each from 0 to 100 in steps of {STEP}.\n")
        ratings = {}
        for scale, text in SCALES.items():
            print(f"{text.title}: {text.question}")
            ratings[scale] = int(_choose(read, f"  {text.low} 0 ... 100 {text.high}: ", steps))
        if weights is not None:
            print("\nWhich of the two contributed more to the workload of this task? 1 or 2.\n")
            for number, pair in enumerate(rng.sample(PAIRS, len(PAIRS)), start=1):
                first, second = rng.sample(pair, 2)
                prompt = f"  {number:2}/15   1 {SCALES[first].title}   2 {SCALES[second].title}: "
                weights[first if _choose(read, prompt, ["1", "2"]) == "1" else second] += 1
        remarks = read("Remarks, or Enter: ").strip()
    except EOFError as error:
        raise ConfigError("the input ended early; nothing was written") from error
    return Answers(ratings=ratings, weights=weights, remarks=remarks)


def _choose(read: Callable[[str], str], prompt: str, choices: Collection[str]) -> str:
    while (answer := read(prompt).strip()) not in choices:
        print(f"  expected {', '.join(choices)}; got {answer!r}")
    return answer


COMMANDS = (
    Command(
        "add", "add a person's trials from a log", Action(ADD, ADD_EXAMPLES, _add_options, _add)
    ),
    Command("tlx", "ask a person for the workload", Action(TLX, TLX_EXAMPLES, _tlx_options, _tlx)),
)
