"""The parts of a ``trill`` subcommand, and parsers that load a subcommand when it is chosen."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Any, NamedTuple


class Action(NamedTuple):
    """The help, the options and the work of a subcommand.

    Attributes:
        text: the full description for its help.
        examples: shown after the options.
        add: adds its options to a parser.
        run: does the work; returns the exit code.
    """

    text: str
    examples: str
    add: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


class Command(NamedTuple):
    """A subcommand in the list of its parent.

    Attributes:
        name: the word to type.
        brief: one line for the list of commands.
        action: the subcommand itself, or ``module:NAME`` to import it from when it is chosen, so
            that a command waits for its own packages only.
    """

    name: str
    brief: str
    action: Action | str

    def load(self) -> Action:
        """Return the action, imported if need be."""
        if isinstance(self.action, Action):
            return self.action
        module, _, name = self.action.partition(":")
        action: Action = getattr(import_module(module), name)
        return action


def add_commands(
    parser: argparse.ArgumentParser, commands: Iterable[Command], dest: str, metavar: str
) -> None:
    """Add subcommands to ``parser``; the chosen one's action becomes the argument ``dest``."""
    group: Any = parser.add_subparsers(required=True, metavar=metavar, parser_class=_CommandParser)
    for command in commands:
        group.add_parser(command.name, help=command.brief, command=command, dest=dest)


def run_chosen(arguments: argparse.Namespace, dest: str) -> int:
    """Run the action that is the argument ``dest``; returns its exit code."""
    action: Action = getattr(arguments, dest)
    return action.run(arguments)


class _CommandParser(argparse.ArgumentParser):
    """Parser of a subcommand, filled when the subcommand is chosen."""

    def __init__(self, *, command: Command | None = None, dest: str = "", **options: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self._command, self._dest = command, dest

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Load the subcommand's options, then parse."""
        command, self._command = self._command, None
        if command is not None:
            action = command.load()
            self.description, self.epilog = action.text, action.examples
            action.add(self)
            self.set_defaults(**{self._dest: action})
        return super().parse_known_args(args, namespace)
