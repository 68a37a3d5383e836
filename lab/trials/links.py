"""Which links a trial runs under: the task's own unless others are given."""

from collections.abc import Mapping, Sequence

from common.errors import ConfigError
from common.links.config import Links, parse_link_options
from services.sim.tasks import find_task

NONE = "none"
"""As an option: no delay at all, not even the task's own."""


def chosen_links(options: Sequence[str]) -> dict[str, str] | None:
    """Read ``--link`` options; None: the task's own.

    Raises:
        ConfigError: a link is not understood, or ``none`` stands beside others.
    """
    if not options:
        return None
    if NONE not in options:
        links = parse_link_options(options)
        Links.from_table(links)
        return links
    if set(options) != {NONE}:
        raise ConfigError(f"expected '{NONE}' or links, got both: {', '.join(options)}")
    return {}


def links_used(task: str, links: Mapping[str, str] | None) -> dict[str, str]:
    """The links of a trial of ``task``; None stands for the task's own.

    Raises:
        TaskError: there is no such task.
    """
    return find_task(task).links if links is None else dict(links)


def links_words(links: Mapping[str, str]) -> str:
    """For instance ``command=paper``."""
    return "; ".join(f"{name}={spec}" for name, spec in links.items()) or NONE
