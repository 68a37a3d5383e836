"""Delays as a person gives them: checked, foretold, and handed to the services of a system."""

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from common.errors import ConfigError
from common.links.config import LAYERS, Links, checked_spec, parse_link_options
from common.links.names import LinkName, parse_name
from common.links.predict import advice, predict
from common.links.spec import LinkSpec
from common.ports import PORT_OFFSETS
from common.topics import ALL_TOPICS, WBC_COMMAND, Topic
from common.transport.config import read_config_file

NO_LINK = "none"
"""For ``--latency``: not even the task's own link."""
_ARRIVALS = 16_000
_GUARD = (
    f"{WBC_COMMAND.name} moves the robot: the plant's guard holds it when a joint command is "
    f"older than {WBC_COMMAND.max_age:g} s, and lets it go limp after 5 s"
)


def links_text(options: Sequence[str]) -> str:
    """Turn ``--latency`` options, each ``name=spec`` or a TOML file, into ``TRILL_LINKS`` text.

    A file holds a table ``[links]``, like the file of the whole stack; a later option wins over an
    earlier one of the same name.

    Raises:
        ConfigError: a file cannot be read or has no links, a name or specification is wrong.
    """
    table: dict[str, Any] = {}
    for option in options:
        table |= _of_file(Path(option)) if _is_file(option) else parse_link_options([option])
    Links.from_table(table)
    return "; ".join(f"{name}={_text(name, value)}" for name, value in table.items())


def variable_with(text: str, environment: Mapping[str, str] | None = None) -> str:
    """``TRILL_LINKS`` with ``text`` as a further source, which wins over what is there."""
    there = (os.environ if environment is None else environment).get("TRILL_LINKS", "")
    return f"{there}{LAYERS}{text}" if there.strip() else text


def warnings(links: Mapping[str, LinkSpec | None]) -> list[str]:
    """What a person should know before these links are used; the rates are the topics' own."""
    said = []
    for text, spec in links.items():
        name = parse_name(text, also=[text.rpartition(":")[0]])
        if spec is None:
            continue
        covered = topics_of(name)
        if WBC_COMMAND in covered and spec != LinkSpec():
            said.append(f"{text}: {_GUARD}")
        told = [
            predict(spec, rate, _ARRIVALS if spec.correlation else 0)
            for rate in sorted({topic.rate for topic in covered if topic.rate})
        ]
        if told:
            worst = max(told, key=lambda prediction: prediction.moved)
            if warning := advice(worst):
                said.append(f"{text}: {warning}")
    return said


def chosen_links(options: list[str]) -> str:
    """Check ``--latency`` options, warn of what will not be as it says, return ``TRILL_LINKS``.

    Raises:
        ConfigError: an option is wrong.
    """
    if not options:
        return ""
    text = links_text(options)
    for warning in warnings(Links.from_variable(text).table):
        print(f"trill: {warning}", file=sys.stderr)
    return variable_with(text)


def system_links(options: list[str], own: Mapping[str, str], config: Path | None) -> str:
    """``TRILL_LINKS`` for a system with a task, of whose own link is said what becomes of it.

    Args:
        options: those of ``--latency``.
        own: links of the task itself; they hold unless others are given: here, in the variable
            or in the file.
        config: TOML file for the whole stack; None: that of ``TRILL_CONFIG``, if any.

    Raises:
        ConfigError: an option or the file is wrong.
    """
    off = options == [NO_LINK]
    if not own:
        return "" if off else chosen_links(options)
    words = "; ".join(f"{name}={spec}" for name, spec in own.items())
    if off:
        print(f"link of this task: {words}; switched off")
        return ""
    if options or links_given(config):
        print(f"link of this task: {words}; replaced by the links given")
        return chosen_links(options)
    print(f"link of this task: {words}; --latency {NO_LINK} switches it off")
    return chosen_links([f"{name}={spec}" for name, spec in own.items()])


def links_given(config: Path | None, environment: Mapping[str, str] | None = None) -> bool:
    """Whether ``TRILL_LINKS`` or the file for the whole stack has links.

    Raises:
        ConfigError: the file cannot be read.
    """
    variables = os.environ if environment is None else environment
    named = variables.get("TRILL_CONFIG")
    path = config or (Path(named) if named else None)
    there = variables.get("TRILL_LINKS", "").strip()
    return bool(there or (path and read_config_file(path).get("links")))


def topics_of(name: LinkName) -> list[Topic[Any]]:
    """Topics that a name may delay for one service or another."""
    services: Iterable[str] = [name.service] if name.service else PORT_OFFSETS
    services = list(services)
    return [t for t in ALL_TOPICS if any(name.covers(service, t.name) for service in services)]


def _is_file(option: str) -> bool:
    return "=" not in option or (option.endswith(".toml") and Path(option).is_file())


def _of_file(path: Path) -> dict[str, Any]:
    if path.suffix != ".toml":
        raise ConfigError(
            f"latency {str(path)!r} not understood; expected 'command=250ms', "
            "'[service:]topic=spec' or a TOML file with a table [links]"
        )
    links = read_config_file(path).get("links")
    if not links:
        raise ConfigError(f"{path}: expected a table [links] with at least one link, got none")
    return links


def _text(name: str, value: Any) -> str:
    """A checked specification as text."""
    spec = checked_spec(name, value)
    text = value if isinstance(value, str) else str(spec)
    if ";" in text:
        raise ConfigError(f"link {name!r}: expected no ';' in a specification, got {text!r}")
    if not isinstance(value, str) and spec.trace:
        raise ConfigError(
            f"link {name!r}: expected recorded delays in a file of their own; write "
            "'trace(delays.csv)'"
        )
    return text
