"""``trill latency``: injected delays of a running system, and what one will do."""

import argparse
import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.errors import ConfigError
from common.links.config import checked_spec
from common.links.names import LinkName, alias_help, parse_name
from common.links.spec import PRESETS, LinkSpec
from common.transport.config import BusConfig, bus_of, split_list
from lab.cli.commands import Command, run_chosen
from lab.errors import LabError

SESSION = "latency"
"""Not in the port table: comes in beside whatever runs."""
_PRESETS = "\n".join(f"  {name:<10} {text}" for name, text in PRESETS.items())
_NAMES = f"""names:
{alias_help()}
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
  trill latency explain tells by how much, and what to write instead."""

TEXT = f"""Inject latency, jitter and loss on links of a running system, see what they do, or
compute it beforehand. A change holds for services that are started later, too, as long as one
service keeps running; it is in the log as LinkChange, and its delay in every message's header.

{_NAMES}

{_SPECS}

At the start the same names and specifications are taken by trill up, demo and drive
(--latency command=250ms), by every service (--link), by TRILL_LINKS and by [links] in the
configuration file. The later of these wins, and within one the more specific name."""
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
    actions = parser.add_subparsers(required=True, metavar="action")
    for command in ACTIONS:
        command.add_to(actions, "latency")


def run(arguments: argparse.Namespace) -> int:
    """Do what the subcommand says; exit code 0, or 1 if nobody answered or was concerned."""
    return run_chosen(arguments, "latency")


def add_latency_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--latency`` to a command that starts a system."""
    parser.add_argument(
        "--latency",
        action="append",
        default=[],
        metavar="NAME=SPEC",
        help="inject a delay, e.g. command=250ms or 'camera=normal(122ms, 190ms) loss=1%%', or "
        "those of a TOML file's table [links]; may be given several times; see trill latency "
        "--help. A task's own link holds unless links are given; 'none' switches it off",
    )


def _set_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", help="command, camera, feedback, both, or [SERVICE:]TOPIC")
    parser.add_argument("spec", nargs="+", help="e.g. 250ms, or 'normal(122ms, 190ms)' loss=1%%")
    _reach(parser)


def _clear_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", help="as for set; without it every link")
    _reach(parser)


def _explain_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", nargs="+", help="a specification")
    parser.add_argument("--rate", type=float, default=20.0, help="messages per second (20)")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw a histogram")


def _reach(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, help="TOML file for the whole stack")
    parser.add_argument("--base-port", type=int, help="of the system (7448, or TRILL_BASE_PORT)")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT)")
    parser.add_argument(
        "--connect",
        type=split_list,
        metavar="ENDPOINT",
        help="come in as a client of this router or service, e.g. tcp/192.0.2.7:7447",
    )


def _bus(arguments: argparse.Namespace) -> BusConfig:
    bus = bus_of(arguments.base_port, arguments.config, arguments.robot)
    if arguments.connect:
        return bus.model_copy(update={"mode": "client", "connect": arguments.connect})
    return bus


@contextlib.contextmanager
def _session(bus: BusConfig) -> Iterator[Any]:
    from common.transport.session import open_session

    session: Any = open_session(bus, SESSION)
    try:
        yield session
    finally:
        session.close()


def _show(arguments: argparse.Namespace) -> int:
    from common.links.client import everybody

    bus = _bus(arguments)
    with _session(bus) as session:
        answers = everybody(session, bus.robot)
    _print_links(answers.replies.values())
    return _complain(answers.errors)


def _set(arguments: argparse.Namespace) -> int:
    from deploy.latency import warnings

    name = _name(arguments.name)
    text = " ".join(arguments.spec)
    spec = checked_spec(name.text, text)
    bus = _bus(arguments)
    for warning in warnings({name.text: spec}):
        print(f"trill: {warning}", file=sys.stderr)
    return _change(bus, name, spec)


def _clear(arguments: argparse.Namespace) -> int:
    name = None if arguments.name is None else _name(arguments.name)
    return _change(_bus(arguments), name, None)


def _change(bus: BusConfig, name: LinkName | None, spec: LinkSpec | None) -> int:
    """Change links and show the inputs concerned; 1 if there are none."""
    from common.links.client import change, everybody

    with _session(bus) as session:
        before = everybody(session, bus.robot).replies
        readers = [
            (service, row.topic)
            for service, reply in before.items()
            for row in reply.inputs
            if name is None or name.covers(service, row.topic)
        ]
        if name is not None and not readers:
            raise LabError(
                f"nobody reads {name.text}: nothing is changed. Running: {', '.join(before)}; "
                "start what reads it first (an operator, for camera and feedback)"
            )
        answers = change(session, bus.robot, None if name is None else {name.text: spec})
        after = everybody(session, bus.robot).replies
    for service, reply in answers.replies.items():
        for changed in reply.changed:
            if changed.previous != changed.link or name is not None:
                was = f"was {changed.previous or 'none'}"
                print(f"{service}: {changed.topic}: {changed.link or 'no delay'} ({was})")
    missed = {service for service, _ in readers} - answers.replies.keys()
    _print_links(after.values())
    if missed and not answers.errors:
        raise LabError(f"no answer from {', '.join(sorted(missed))}; look with `latency show`")
    return _complain(answers.errors)


def _explain(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from common.links.predict import advice, predict
    from lab.monitor.latency_text import prediction_table, prediction_words

    if not arguments.rate > 0.0:
        raise ConfigError(f"--rate: expected messages per second above 0, got {arguments.rate:g}")
    told = predict(LinkSpec.parse(" ".join(arguments.spec)), arguments.rate)
    print(f"{told.spec}, {told.rate:g} messages per second")
    Console().print(prediction_table(told))
    print(prediction_words(told))
    if warning := advice(told):
        print(f"warning: {warning}")
    if arguments.plot is not None:
        from lab.review.delay_plot import Panel, write_histograms

        marks = (("asked mean", told.requested.mean), ("mean", told.predicted.mean))
        title = f"{told.spec}  at {told.rate:g} messages/s"
        write_histograms(arguments.plot, [Panel(title, told.delays, marks)])
        print(f"drawn in {arguments.plot}")
    return 0


def _name(text: str) -> LinkName:
    """A name of which only the bus knows whether its service exists."""
    service, _, _ = text.rpartition(":")
    return parse_name(text, also=[service] if service else [])


def _print_links(replies: Any) -> None:
    from rich.console import Console

    from lab.monitor.latency_text import links_table

    Console(width=None if sys.stdout.isatty() else 140).print(links_table(replies))


def _complain(errors: tuple[str, ...]) -> int:
    for error in errors:
        print(f"trill: {error}", file=sys.stderr)
    return int(bool(errors))


_HOW = f"{_NAMES}\n\n{_SPECS}"
ACTIONS = (
    Command("show", "what is injected now", "Every input of every service.", "", _reach, _show),
    Command(
        "set",
        "put a delay on links",
        "Put a delay on links of a running system.",
        _HOW,
        _set_options,
        _set,
    ),
    Command(
        "clear",
        "take delays away",
        "Take away a delay, or all of them.",
        "",
        _clear_options,
        _clear,
    ),
    Command(
        "explain",
        "what a delay will do",
        "Compute, without any system, what a specification will do to messages at a rate.",
        _HOW,
        _explain_options,
        _explain,
    ),
)
COMMAND = Command(
    "latency",
    "inject latency, jitter and loss",
    TEXT,
    EXAMPLES,
    add_arguments,
    run,
)
