"""Define a subcommand of ``trill``: its help texts, its options and what it runs."""

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple


class Command(NamedTuple):
    """A subcommand, or a subcommand of a subcommand.

    Attributes:
        name: word on the command line.
        brief: one line for the list of commands.
        text: full description for the command's help.
        examples: shown after the options in the command's help.
        add: adds the command's options to its parser.
        run: runs the command and returns the exit code.
    """

    name: str
    brief: str
    text: str
    examples: str
    add: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]

    def add_to(self, commands: Any, name: str) -> None:
        """Add a parser to the subparsers ``commands``; it stores this command as ``name``."""
        parser: argparse.ArgumentParser = commands.add_parser(
            self.name,
            help=self.brief,
            description=self.text,
            epilog=self.examples,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.add(parser)
        parser.set_defaults(**{name: self})


def run_chosen(arguments: argparse.Namespace, name: str) -> int:
    """Run the command that a parser stored as ``name``; returns the exit code."""
    chosen: Command = getattr(arguments, name)
    return chosen.run(arguments)
