"""What a subcommand of ``trill`` consists of."""

import argparse
from collections.abc import Callable
from typing import NamedTuple


class Command(NamedTuple):
    """One subcommand.

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
