"""``python -m docs.reference``: write the reference pages, or check that they are up to date."""

import argparse
import sys
from collections.abc import Sequence

from docs.reference import PAGES, outdated, write


def main(argv: Sequence[str] | None = None) -> int:
    """Write the pages; with ``--check`` return 1 if one is out of date."""
    parser = argparse.ArgumentParser(
        prog="python -m docs.reference",
        description="Write docs/reference/*.md from the topic table and the configuration models.",
    )
    parser.add_argument("--check", action="store_true", help="write nothing; fail if out of date")
    arguments = parser.parse_args(argv)
    if not arguments.check:
        write()
        print(f"wrote {', '.join(PAGES)}")
        return 0
    for name in (pages := outdated()):
        print(f"docs/reference/{name} is out of date: run `make docs`", file=sys.stderr)
    return int(bool(pages))


if __name__ == "__main__":
    raise SystemExit(main())
