"""``trill stop``, ``trill resume`` and ``trill reset``: the plant, from any shell."""

import argparse

from common.transport.config import BusConfig
from lab.cli.bus import add_bus_options, chosen_bus
from lab.cli.commands import Action

STOP = """Stop the robot: its motors go limp at once, and stay so until `trill resume`. The stop is
sent again and again until the plant confirms it. Anybody may stop the robot, whoever has it."""
STOP_EXAMPLES = """examples:
  trill stop
  trill stop smoke from the left knee
  trill stop --connect tcp/robot:7447         from another machine
"""
RESUME = """End the emergency stop that is latched now; nothing else ends one, neither a reset nor a
restart. The robot stays limp until its controller sends commands again, and no operator has it
until a person asks for it anew. A stop that comes meanwhile stays. To let a paused plant go on is
another matter: that is the space key of the keyboard operator."""
RESUME_EXAMPLES = """examples:
  trill resume
  trill resume knee looked at
"""
RESET = """Stand the simulated robot up where it started, with the next seed or a given one, also
after a fall. An emergency stop stays latched. A trial of a task begins anew."""
RESET_EXAMPLES = """examples:
  trill reset
  trill reset --seed 7
"""


def _add_reason(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="*", metavar="REASON", help="why; kept in status and log")
    parser.add_argument("--reason", default="", help="the same, as an option")
    add_bus_options(parser)


def _add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=int, default=-1, help="of the new start (default: the next)")
    add_bus_options(parser)


def _reason(arguments: argparse.Namespace) -> str:
    from lab.live.plant_remote import who

    return (arguments.reason or " ".join(arguments.words) or who())[:200]


def _stop(arguments: argparse.Namespace) -> int:
    from lab.live.plant_remote import PlantRemote, stopped_by

    bus = chosen_bus(arguments)
    with PlantRemote(bus, "trill-stop") as plant:
        status = plant.stop(_reason(arguments))
    print(f"{bus.robot} is STOPPED (stop {status.stops}), by {stopped_by(status)}")
    print(f"`trill resume{_options(bus)}` ends the stop")
    return 0


def _resume(arguments: argparse.Namespace) -> int:
    from lab.live.plant_remote import PlantRemote, stopped_by

    bus = chosen_bus(arguments)
    with PlantRemote(bus, "trill-resume") as plant:
        before, after = plant.clear(_reason(arguments))
    if before is after:
        print(f"{bus.robot} is not stopped, its guard is {after.guard.name}: nothing to end")
        return 0
    print(f"{bus.robot} is no longer stopped (stop {before.stops}, by {stopped_by(before)})")
    print("its operators have to ask for it anew: Enter at the keyboard, or start the script again")
    if after.fallen:
        print(f"it has fallen: `trill reset{_options(bus)}` stands it up")
    return 0


def _reset(arguments: argparse.Namespace) -> int:
    from common.schemas import GuardMode
    from lab.live.plant_remote import PlantRemote, stopped_by

    bus = chosen_bus(arguments)
    with PlantRemote(bus, "trill-reset") as plant:
        status = plant.reset(arguments.seed)
    print(f"{bus.robot} was reset and stands at its start, guard {status.guard.name}")
    if status.guard is GuardMode.ESTOP:
        print(f"it stays STOPPED, by {stopped_by(status)}; `trill resume{_options(bus)}` ends that")
    return 0


def _options(bus: BusConfig) -> str:
    """Return the options that name the same bus, for a command to type next."""
    default = BusConfig()
    named = {"--base-port": bus.base_port, "--robot": bus.robot}
    usual = {"--base-port": default.base_port, "--robot": default.robot}
    text = "".join(f" {name} {value}" for name, value in named.items() if value != usual[name])
    return text + (f" --connect {','.join(bus.connect)}" if bus.connect else "")


STOP_ACTION = Action(STOP, STOP_EXAMPLES, _add_reason, _stop)
RESUME_ACTION = Action(RESUME, RESUME_EXAMPLES, _add_reason, _resume)
RESET_ACTION = Action(RESET, RESET_EXAMPLES, _add_seed, _reset)
