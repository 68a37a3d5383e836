"""Options that delay links: ``--latency`` of a live system and ``--link`` of simulated trials.

A task may have links of its own, which hold unless others are given; :data:`NO_LINK` switches them
off.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from common.errors import ConfigError
from common.links.config import LAYERS, LinkName, Links, checked_spec, parse_link_options
from common.links.predict import predict
from common.links.spec import LinkSpec
from common.ports import PORT_OFFSETS
from common.topics import ALL_TOPICS, WBC_COMMAND
from common.transport.config import read_config_file

NO_LINK = "none"
"""The option for no delay at all, not even the task's own."""
_ARRIVALS = 16_000
_GUARD = (
    f"{WBC_COMMAND.name} moves the robot: the plant's guard holds it when a joint command is "
    f"older than {WBC_COMMAND.max_age:g} s, and lets it go limp after 5 s"
)


def chosen_links(options: Sequence[str]) -> dict[str, str] | None:
    """Read options, each ``name=spec``, a TOML file with a table ``[links]``, or ``none``.

    A later option wins over an earlier one of the same name.

    Returns:
        specifications by name; None without options: the task's own links hold.

    Raises:
        ConfigError: a file cannot be read or has no links, a name or specification is wrong, or
            ``none`` stands beside others.
    """
    if not options:
        return None
    if NO_LINK in options:
        if set(options) != {NO_LINK}:
            raise ConfigError(f"expected '{NO_LINK}' or links, got both: {', '.join(options)}")
        return {}
    table: dict[str, Any] = {}
    for option in options:
        is_file = "=" not in option or (option.endswith(".toml") and Path(option).is_file())
        table |= _file_links(Path(option)) if is_file else parse_link_options([option])
    Links.from_table(table)
    return {name: _text(name, value) for name, value in table.items()}


def links_used(task: str, links: Mapping[str, str] | None) -> dict[str, str]:
    """Return the links of a trial of ``task``; None stands for the task's own.

    Raises:
        TaskError: there is no such task.
    """
    # A live system without a task needs neither the tasks nor MuJoCo.
    from services.sim.tasks import find_task

    return find_task(task).links if links is None else dict(links)


def system_links(options: Sequence[str], own: Mapping[str, str], config: Path | None) -> str:
    """Choose the links of a live system, print what becomes of its task's own, and warn.

    Args:
        options: those of ``--latency``.
        own: links of the task; they hold unless others are given here, in ``TRILL_LINKS`` or in
            the file.
        config: TOML file for the whole stack; None: that of ``TRILL_CONFIG``, if any.

    Returns:
        the text of ``TRILL_LINKS`` for the services; empty: as it is in the environment.

    Raises:
        ConfigError: an option or the file is wrong.
    """
    chosen = chosen_links(options)
    if own:
        if chosen == {}:
            fate = "switched off"
        elif chosen or _links_elsewhere(config):
            fate = "replaced by the links given"
        else:
            fate = f"--latency {NO_LINK} switches it off"
            chosen = dict(own)
        print(f"link of this task: {links_text(own)}; {fate}")
    if not chosen:
        return ""
    for warning in link_warnings({name: checked_spec(name, spec) for name, spec in chosen.items()}):
        print(f"trill: {warning}", file=sys.stderr)
    there = os.environ.get("TRILL_LINKS", "")
    text = links_text(chosen)
    return f"{there}{LAYERS}{text}" if there.strip() else text


def link_warnings(links: Mapping[str, LinkSpec]) -> list[str]:
    """Return what a person should know before links are used, at the nominal rates of the topics.

    Raises:
        ConfigError: a name is unknown.
    """
    found = []
    for text, spec in links.items():
        name = LinkName.parse(text)
        services = [name.service] if name.service else list(PORT_OFFSETS)
        topics = [
            t for t in ALL_TOPICS if any(name.covers(service, t.name) for service in services)
        ]
        if WBC_COMMAND in topics and spec != LinkSpec():
            found.append(f"{text}: {_GUARD}")
        predictions = [
            predict(spec, rate, _ARRIVALS if spec.correlation else 0)
            for rate in sorted({topic.rate for topic in topics if topic.rate})
        ]
        worst = max(predictions, key=lambda prediction: prediction.shift, default=None)
        if worst is not None and worst.warning:
            found.append(f"{text}: {worst.warning}")
    return found


def links_text(links: Mapping[str, str]) -> str:
    """Write links the way ``TRILL_LINKS`` has them, for instance ``command=paper``; or ``none``."""
    return "; ".join(f"{name}={spec}" for name, spec in links.items()) or NO_LINK


def _links_elsewhere(config: Path | None) -> bool:
    """Return whether ``TRILL_LINKS`` or the file for the whole stack has links."""
    named = os.environ.get("TRILL_CONFIG")
    path = config or (Path(named) if named else None)
    there = os.environ.get("TRILL_LINKS", "").strip()
    return bool(there or (path and read_config_file(path).get("links")))


def _file_links(path: Path) -> dict[str, Any]:
    if path.suffix != ".toml":
        raise ConfigError(
            f"link {str(path)!r} not understood; expected 'command=250ms', "
            "'[service:]topic=spec' or a TOML file with a table [links]"
        )
    links = read_config_file(path).get("links")
    if not links:
        raise ConfigError(f"{path}: expected a table [links] with at least one link, got none")
    return links


def _text(name: str, value: Any) -> str:
    """Write a specification of an option or file as text."""
    if isinstance(value, str):
        if ";" in value:
            raise ConfigError(f"link {name!r}: expected no ';' in a specification, got {value!r}")
        return value
    spec = checked_spec(name, value)
    if spec.trace:
        raise ConfigError(
            f"link {name!r}: expected recorded delays in a file of their own; write "
            "'trace(delays.csv)'"
        )
    return str(spec)
