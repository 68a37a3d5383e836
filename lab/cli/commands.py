"""What a subcommand of ``trill`` consists of."""

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple


class Command(NamedTuple):
    """One subcommand, or a subcommand of one.

    Attributes:
        name: what is typed.
        brief: one line for the list of commands.
        text: what it does, in full, for its help.
        examples: after the options.
        add: adds its arguments.
        run: does it; returns the exit code.
    """

    name: str
    brief: str
    text: str
    examples: str
    add: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]

    def under(self, commands: Any, name: str) -> None:
        """Add it to the subcommands of a parser; chosen, it is the argument ``name``."""
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
    """Run the subcommand that is the argument ``name``."""
    chosen: Command = getattr(arguments, name)
    return chosen.run(arguments)
