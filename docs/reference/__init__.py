"""Generates the reference pages from the code, so that they cannot contradict it."""

from collections.abc import Callable, Mapping
from pathlib import Path

from docs.reference.configuration import configuration_page
from docs.reference.topics import topics_page

FOLDER = Path(__file__).parent
"""Where the pages are."""

PAGES: Mapping[str, Callable[[], str]] = {
    "configuration.md": configuration_page,
    "topics.md": topics_page,
}
"""The generated pages by file name."""


def outdated() -> list[str]:
    """Return the names of the pages that differ from what the code says."""
    return [
        name
        for name, page in PAGES.items()
        if not (FOLDER / name).is_file() or (FOLDER / name).read_text(encoding="utf-8") != page()
    ]


def write() -> None:
    """Write every page."""
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")
