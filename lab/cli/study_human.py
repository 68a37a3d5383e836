"""``trill study add`` and ``trill study tlx``: trials and answers of persons."""

import argparse
import json
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from common.errors import ConfigError, explain
from deploy.system import LOG_FILE
from lab.cli.commands import Action, Command

if TYPE_CHECKING:
    from lab.studies.latency.plan import Plan
    from lab.studies.latency.row import TrialRow
    from lab.studies.latency.tlx import AnswerSheet, Scale

ADD = """Take in the trials of a person from a recorded log: verdict, time and contacts as the same
judge saw them, latencies as the services measured them, and how the hands moved. Every trial of the
log whose verdict was reached counts, whatever it was, but what passed before the operator came; all
of them were done under one condition. A trial is taken in once: participant, task, condition and
seed tell it. A log whose latencies are not those of the condition is refused; --anyway takes it in.
Then write the report anew: trill study latency --report DIR."""
ADD_EXAMPLES = """examples:
  trill up --task door/unlock --seed 3 --latency command=250ms          in one terminal
  python -m services.teleop keyboard                                    in another, or a headset
  trill study add runs/20260131-120000 --participant P01 --condition latency-250
"""
TLX = """Ask one person for the NASA Task Load Index, in this terminal: six scales from 0 to 100 in
steps of 5, none filled in beforehand, then the 15 pairs in random order (--no-pairs leaves them
out; the raw score needs none). Answers can be given in a file instead. The sheet is written when
everything is answered; Ctrl-C leaves nothing behind."""
TLX_EXAMPLES = """examples:
  trill study tlx --participant P01 --task door/unlock --condition interpolation --seeds 3 4 5
  trill study tlx --participant P01 --task door/unlock --condition raw --answers p01.json

a file of answers; `choices` may be left out, and then has no weighted score:
  {"ratings": {"mental": 55, "physical": 20, "temporal": 40, "performance": 10, "effort": 60,
   "frustration": 25}, "choices": [{"pair": ["effort", "mental"], "chosen": "mental"}, ... all 15],
   "remarks": ""}
"""


def commands(root: Path) -> tuple[Command, Command]:
    """Both, as subcommands of ``trill study``; ``root`` is the usual directory."""
    return (
        Command(
            "add",
            "take in a person's trials from a log",
            Action(ADD, ADD_EXAMPLES, lambda parser: _add_options(parser, root), _add),
        ),
        Command(
            "tlx",
            "ask a person for the workload",
            Action(TLX, TLX_EXAMPLES, lambda parser: _tlx_options(parser, root), _tlx),
        ),
    )


def _add_options(add: argparse.ArgumentParser, root: Path) -> None:
    add.add_argument("log", type=Path, help="the run's directory or its log")
    add.add_argument(
        "--anyway",
        action="store_true",
        help="also where measured latencies are not the condition's",
    )
    _session_options(add, root)


def _tlx_options(tlx: argparse.ArgumentParser, root: Path) -> None:
    tlx.add_argument("--task", required=True, help="which was done")
    tlx.add_argument("--seeds", type=int, nargs="*", default=[], help="of the trials it is about")
    tlx.add_argument("--no-pairs", action="store_true", help="only the six scales")
    tlx.add_argument("--remarks", default="", help="of the person; asked for if not given")
    tlx.add_argument("--answers", type=Path, metavar="FILE.json", help="do not ask; take these")
    _session_options(tlx, root)


def _session_options(parser: argparse.ArgumentParser, root: Path) -> None:
    parser.add_argument("--participant", required=True, help="pseudonym, as P01; never a name")
    parser.add_argument("--condition", required=True, help="its name in the study")
    parser.add_argument("--out", type=Path, default=root, help=f"the study ({root})")


def _add(arguments: argparse.Namespace) -> int:
    from rich.console import Console
    from rich.progress import Progress

    from lab.errors import LatencyStudyError
    from lab.studies.latency.fromlog import trials_of
    from lab.studies.latency.store import Store
    from lab.studies.latency.tlx import is_pseudonym
    from services.logger.read.reader import LogReader

    store = Store(arguments.out)
    plan = store.plan()
    condition = plan.condition(arguments.condition)
    if not is_pseudonym(arguments.participant):
        raise ConfigError(
            f"--participant: expected letters, digits, - and _, 40 at most; got "
            f"{arguments.participant!r}"
        )
    path = arguments.log / LOG_FILE if arguments.log.is_dir() else arguments.log
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("reading the log", total=None)
        rows = trials_of(
            LogReader(path), arguments.participant, condition, lambda: progress.advance(bar)
        )
    known = {row.key for row in store.human_rows()}
    # All or none: half a log taken in could not be told from a whole one.
    for row in rows:
        if row.task not in plan.tasks:
            raise LatencyStudyError(
                f"{path}: {row.task} is not in the study {store.root}; expected one of "
                f"{', '.join(plan.tasks)}; nothing taken in"
            )
        if not arguments.anyway and row.key not in known:
            _check_latencies(path, row)
    for row in rows:
        text = f"{row.task} {row.condition} seed {row.seed}, {row.participant}"
        if row.key in known:
            print(f"{text}: there already, left as it is")
            continue
        known.add(row.key)
        store.add(row)
        measured = row.command.mean
        late = "not measured" if measured is None else f"{1e3 * measured:.0f} ms"
        print(
            f"{text}: {row.verdict} at {row.time:.1f} s; command latency asked for "
            f"{1e3 * row.command.asked_mean:.0f} ms, measured {late}"
        )
    return 0


def _check_latencies(path: Path, row: "TrialRow") -> None:
    from lab.errors import LatencyStudyError
    from lab.studies.latency.row import OWN_COMMAND, OWN_FEEDBACK

    for name, take, own in (
        ("command", row.command, OWN_COMMAND),
        ("feedback", row.feedback, OWN_FEEDBACK),
    ):
        if not take.agrees(own):
            raise LatencyStudyError(
                f"{path}: {row.task} seed {row.seed}: condition {row.condition} asks for "
                f"{1e3 * take.asked_mean:.0f} ms of {name} latency, measured were "
                f"{1e3 * (take.mean or 0.0):.0f} ms; is it the log of another condition? Nothing "
                "taken in; --anyway takes it in all the same"
            )


def _tlx(arguments: argparse.Namespace) -> int:
    from lab.studies.latency.store import SHEETS, Store
    from lab.studies.latency.tlx import write_sheet

    store = Store(arguments.out)
    _check_in_plan(store.plan(), arguments)
    sheet = _from_file(arguments) if arguments.answers is not None else _asked(arguments)
    path = write_sheet(store.root / SHEETS, sheet)
    weighted = sheet.weighted_score
    scores = f"raw score {sheet.raw_score:.1f}"
    print(scores if weighted is None else f"{scores}, weighted {weighted:.1f}")
    print(path)
    return 0


def _check_in_plan(plan: "Plan", arguments: argparse.Namespace) -> None:
    plan.condition(arguments.condition)
    if arguments.task not in plan.tasks:
        raise ConfigError(
            f"--task: {arguments.task!r} is not in the study; expected {' or '.join(plan.tasks)}"
        )


def _sheet(arguments: argparse.Namespace, answers: dict[str, Any]) -> "AnswerSheet":
    from lab.studies.latency.tlx import AnswerSheet, now

    values = {
        "participant": arguments.participant,
        "task": arguments.task,
        "condition": arguments.condition,
        "seeds": arguments.seeds,
        "remarks": arguments.remarks,
        "date": now().isoformat(),
    }
    try:
        # Through JSON, as a file of answers comes: lists are tuples there.
        return AnswerSheet.model_validate_json(json.dumps(values | answers))
    except ValidationError as error:
        raise ConfigError(f"a value is wrong, nothing written:\n{explain(error)}") from error


def _from_file(arguments: argparse.Namespace) -> "AnswerSheet":
    path: Path = arguments.answers
    try:
        answers = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read the answers {path}: {error}") from error
    if not isinstance(answers, dict):
        raise ConfigError(f"{path}: expected an object with ratings, got {type(answers).__name__}")
    for name in ("participant", "task", "condition"):
        if answers.get(name, getattr(arguments, name)) != getattr(arguments, name):
            raise ConfigError(
                f"{path} is of {name} {answers[name]!r}, the option says "
                f"{getattr(arguments, name)!r}; which?"
            )
    return _sheet(arguments, answers)


def _asked(arguments: argparse.Namespace) -> "AnswerSheet":
    if not sys.stdin.isatty():
        raise ConfigError("nobody to ask: the input is no terminal; give --answers FILE.json")
    _sheet_without_answers(arguments)
    answers = ask(input, print, random.SystemRandom(), pairs=not arguments.no_pairs)
    if not arguments.remarks:
        answers["remarks"] = _line(input, "Remarks, or Enter: ")
    return _sheet(arguments, answers)


def _sheet_without_answers(arguments: argparse.Namespace) -> None:
    """Refuse wrong options before a person answers for nothing."""
    from lab.studies.latency.tlx import SCALES

    _sheet(arguments, {"ratings": dict.fromkeys(SCALES, 0)})


def ask(
    read: Callable[[str], str],
    show: Callable[[str], None],
    rng: random.Random,
    *,
    pairs: bool,
) -> dict[str, Any]:
    """Ask for the scales and the pairs, again and again until each answer is one.

    Args:
        read: shows a prompt and returns what was typed.
        show: shows a line.
        rng: order of the pairs.
        pairs: whether to ask for them.

    Returns:
        ``ratings`` and ``choices`` for a sheet.

    Raises:
        ConfigError: the input ended before everything was answered.
    """
    from lab.studies.latency.tlx import SCALES, shuffled_pairs

    show("Six scales, each from 0 to 100 in steps of 5.\n")
    ratings: dict[Scale, int] = {}
    for scale, text in SCALES.items():
        show(f"{text.title}: {text.question}")
        ratings[scale] = _rating(read, show, f"  {text.low} 0 ... 100 {text.high}: ")
    choices: list[dict[str, Any]] = []
    if pairs:
        show("\nWhich of the two contributed more to the workload of this task? 1 or 2.\n")
        for number, pair in enumerate(shuffled_pairs(rng), start=1):
            first, second = (SCALES[scale].title for scale in pair)
            prompt = f"  {number:2}/15   1 {first}   2 {second}: "
            while (answer := _line(read, prompt)) not in {"1", "2"}:
                show(f"  expected 1 or 2, got {answer!r}")
            choices.append({"pair": pair, "chosen": pair[int(answer) - 1]})
    return {"ratings": ratings, "choices": choices}


def _rating(read: Callable[[str], str], show: Callable[[str], None], prompt: str) -> int:
    while True:
        answer = _line(read, prompt)
        if answer.isdecimal() and int(answer) <= 100 and int(answer) % 5 == 0:
            return int(answer)
        show(f"  expected 0, 5, 10 ... 100, got {answer!r}")


def _line(read: Callable[[str], str], prompt: str) -> str:
    try:
        return read(prompt).strip()
    except EOFError as error:
        raise ConfigError("the input ended before everything was answered; nothing written") from (
            error
        )
