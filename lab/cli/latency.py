"""``trill latency``: read and set the injected delays of a running system, and predict them."""

import argparse
import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.errors import ConfigError
from common.links.config import ALIASES, LinkName, checked_spec
from common.links.spec import PRESETS, LinkSpec
from lab.cli.bus import add_bus_options, chosen_bus
from lab.cli.commands import Action, Command, add_commands, run_chosen
from lab.errors import LabError

if TYPE_CHECKING:
    from common.links.client import Answers

SESSION = "latency"
"""Name on the bus; not in the port table, so it joins whatever runs."""
_ALIASES = "\n".join(f"  {name:<10} {alias.description}" for name, alias in ALIASES.items())
_PRESETS = "\n".join(f"  {name:<10} {text}" for name, text in PRESETS.items())
_NAMES = f"""names:
{_ALIASES}
  TOPIC, SERVICE:TOPIC, SERVICE:camera ...: one topic, for all or one consumer.
  The emergency stop, requests to the plant and wbc/command are delayed under their own names
  only. Careful with wbc/command: the plant's guard holds the robot when a joint command is older
  than 0.1 s, and lets it go limp after 5 s."""
_SPECS = f"""specifications:
  250ms                                     constant
  normal(122ms, 190ms) loss=1% seed=7       mean, standard deviation; draws below 0 count as 0
  lognormal(122ms, 190ms) corr=10s          jitter that changes over 10 s
  trace(delays.csv) order=free              recorded delays; messages may overtake each other
{_PRESETS}
             (the TRILL paper's real robot, 122 ± 190 ms; the mean over one minute varies widely)
  Messages keep their order unless order=free, which makes a wide jitter longer than asked for:
  trill latency explain predicts by how much and names remedies."""

TEXT = f"""Inject latency, jitter and loss on links of a running system, measure what they do, or
predict it beforehand. A change also holds for services that are started later, as long as one
service keeps running. It is in the log as LinkChange, and its delay in every message's header.

{_NAMES}

{_SPECS}

trill up, demo and drive take the same names and specifications at the start (--latency
command=250ms), and so do every service (--link), TRILL_LINKS and the table [links] of the
configuration file. What is set while the system runs wins over --link, that over TRILL_LINKS and
--latency, and these over the file; within one of them the more specific name wins."""
EXAMPLES = """examples:
  trill latency show
  trill latency set command 250ms
  trill latency set camera "normal(122ms, 190ms) order=free" loss=1% seed=7
  trill latency set keyboard:camera paper
  trill latency clear command                 or all: trill latency clear
  trill latency explain "normal(122ms, 190ms)" --rate 20 --plot delays.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``trill latency``."""
    add_commands(parser, COMMANDS, "latency", "action")


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand; exit code 0, or 1 if a service refused."""
    return run_chosen(arguments, "latency")


def _set_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", help="command, camera, feedback, both, or [SERVICE:]TOPIC")
    parser.add_argument("spec", nargs="+", help="e.g. 250ms, or 'normal(122ms, 190ms)' loss=1%%")
    add_bus_options(parser)


def _clear_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="as for set; without it every link")
    add_bus_options(parser)


def _explain_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", nargs="+", help="a specification")
    parser.add_argument("--rate", type=float, default=20.0, help="messages per second (20)")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="plot a histogram")


@contextlib.contextmanager
def _session(arguments: argparse.Namespace) -> Iterator[tuple[Any, str]]:
    """Open a session on the bus of a running system; yields it with the robot's name."""
    from common.transport.session import open_session

    bus = chosen_bus(arguments)
    session: Any = open_session(bus, SESSION)
    try:
        yield session, bus.robot
    finally:
        session.close()


def _show(arguments: argparse.Namespace) -> int:
    from common.links.client import read_links

    with _session(arguments) as (session, robot):
        return _print_answers(read_links(session, robot))


def _set(arguments: argparse.Namespace) -> int:
    from lab.trials.links import link_warnings

    name = LinkName.parse(arguments.name)
    spec = checked_spec(name.text, " ".join(arguments.spec))
    for warning in link_warnings({name.text: spec}):
        print(f"trill: {warning}", file=sys.stderr)
    return _change(arguments, name, spec)


def _clear(arguments: argparse.Namespace) -> int:
    name = None if arguments.name is None else LinkName.parse(arguments.name)
    return _change(arguments, name, LinkSpec())


def _change(arguments: argparse.Namespace, name: LinkName | None, spec: LinkSpec) -> int:
    """Put ``spec`` on the links called ``name`` (None: on all), and print what has changed.

    Raises:
        LabError: no service reads what is named, or one that does gives no answer.
    """
    from common.links.client import ask, read_links

    with _session(arguments) as (session, robot):
        before = read_links(session, robot)
        now = time.time_ns()
        if name is None:
            live = before.live.without_links(now)
        else:
            live = before.live.with_links({name.text: spec}, now)
        links = {
            (service, row.topic): row.link
            for service, reply in before.replies.items()
            for row in reply.inputs
            if name is None or name.covers(service, row.topic)
        }
        if name is not None and not links:
            raise LabError(
                f"no running service reads {name.text}: nothing is changed. Running: "
                f"{', '.join(before.replies)}; start what reads it first (an operator, for camera "
                "and feedback)"
            )
        after = ask(session, robot, live)
    for service, reply in after.replies.items():
        for row in reply.inputs:
            previous = links.get((service, row.topic))
            if previous is not None and (name is not None or previous != row.link):
                was = f"was {previous or 'none'}"
                print(f"{service}: {row.topic}: {row.link or 'no delay'} ({was})")
    code = _print_answers(after)
    missed = {service for service, _ in links} - after.replies.keys()
    if missed and not after.errors:
        raise LabError(f"no answer from {', '.join(sorted(missed))}; look with `latency show`")
    return code


def _explain(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from common.links.predict import predict
    from lab.monitor.latency_text import prediction_table, prediction_text

    if not arguments.rate > 0.0:
        raise ConfigError(f"--rate: expected messages per second above 0, got {arguments.rate:g}")
    prediction = predict(LinkSpec.parse(" ".join(arguments.spec)), arguments.rate)
    title = f"{prediction.spec}, {prediction.rate:g} messages per second"
    print(title)
    Console().print(prediction_table(prediction))
    print(prediction_text(prediction))
    if prediction.warning:
        print(f"warning: {prediction.warning}")
    if arguments.plot is not None:
        from lab.review.delay_plot import Panel, write_histograms

        requested, predicted = prediction.requested.mean, prediction.predicted.mean
        marks = (("requested mean", requested), ("predicted mean", predicted))
        write_histograms(arguments.plot, [Panel(title, prediction.delays, marks)])
        print(f"plotted in {arguments.plot}")
    return 0


def _print_answers(answers: "Answers") -> int:
    """Print all links and the refusals; exit code 1 if there are any."""
    from rich.console import Console

    from lab.monitor.latency_text import links_table

    width = None if sys.stdout.isatty() else 140
    Console(width=width).print(links_table(answers.replies.values()))
    for error in answers.errors:
        print(f"trill: {error}", file=sys.stderr)
    return int(bool(answers.errors))


_HOW = f"{_NAMES}\n\n{_SPECS}"
COMMANDS = (
    Command(
        "show",
        "list the delays injected now",
        Action(
            "List every input of every service with its delay, requested and achieved.",
            "",
            add_bus_options,
            _show,
        ),
    ),
    Command(
        "set",
        "put a delay on links",
        Action("Put a delay on links of a running system.", _HOW, _set_options, _set),
    ),
    Command(
        "clear",
        "remove delays from links",
        Action(
            "Remove a delay, or all of them, configured ones included.",
            "",
            _clear_options,
            _clear,
        ),
    ),
    Command(
        "explain",
        "predict the delays of a specification",
        Action(
            "Predict, without any system, the delays that a specification yields at a message "
            "rate.",
            _HOW,
            _explain_options,
            _explain,
        ),
    ),
)
ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
