"""Compare two builds of this project, in turn, by every row of the performance table.

python benchmarks/compare.py OLD [NEW] [--rows time,tick] [--rounds N] [--json FILE]
"""

import argparse
import json
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from benchmarks.builds import OWN_ROOT, Build
from benchmarks.comparison import GROUPS, ROWS, Result, Row, judge, table
from benchmarks.rounds import PLACO, Comparison, check_tree
from common.program import run_program
from lab.progress import ProgressBar

ENOUGH = 5
"""Rounds from which on medians are worth quoting."""
DESCRIPTION = """Compare two source trees of this project by every row of the performance table.
Each round runs each workload on both builds, in fresh processes of this interpreter, with its
packages. Figures are medians over the rounds, ratios the median of the rounds' own new / old, with
their range. Most rows are CPU time: both builds run in turns of a tenth of a second, so that a busy
machine slows both alike. In the rows marked (wall) one run follows the other: measure these on a
quiet machine. The exit code is 0 if every must is kept, 1 if not."""
EPILOG = f"""rows: {", ".join(GROUPS)}
  time      plant and controller while walking, without cameras, one thread
  pictures  a stereo pair of each scene, software OpenGL
  collect   the command, start-up included: by far the slowest row
  tick      a whole controller tick in closed loop; tail: its p99 / median
  placo     our tick / that of a controller of placo (C++) with like tasks at the same states. placo
            brings its own pinocchio, so it has an interpreter of its own:
              python -m venv placo && placo/bin/pip install placo==0.10.2
              python benchmarks/compare.py OLD --rows placo --placo-python placo/bin/python
  bus       round trips between two processes, typed and raw in turn
  cameras, memory   30 s of trill demo on two cores

examples:
  git worktree add ../old v0.1.0
  python benchmarks/compare.py ../old                       everything
  python benchmarks/compare.py ../old --rows tick,tail      one thing
  python benchmarks/compare.py ../old ../old --rows time    how far two equal builds differ here
  python benchmarks/compare.py ../old --rounds 1            a quick look, no figures to quote
"""


def _rows(text: str) -> list[Row]:
    wanted = text.split(",")
    if unknown := sorted(set(wanted) - set(GROUPS)):
        raise argparse.ArgumentTypeError(
            f"no row {', '.join(unknown)}; expected some of {', '.join(GROUPS)}, with commas"
        )
    return [row for row in ROWS if row.group in wanted]


def _count(text: str) -> int:
    if (count := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"expected 1 or more, got {count}")
    return count


def _interpreter(text: str) -> str:
    found = shutil.which(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected an interpreter, got {text}")
    # Where links lead is another interpreter's place, without what this one has installed.
    return str(Path(found).absolute())


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("old", type=Path, help="source tree to compare with")
    add("new", type=Path, nargs="?", default=OWN_ROOT, help="source tree to judge (this one)")
    add("--rows", type=_rows, default=ROWS, metavar="NAME,...", help="only these rows (all)")
    add("--rounds", type=_count, default=ENOUGH, metavar="N", help=f"rounds ({ENOUGH})")
    add("--json", type=Path, metavar="FILE", help="write every figure of every round to a file")
    add(
        "--placo-python",
        type=_interpreter,
        metavar="PATH",
        default=sys.executable if find_spec(PLACO) else None,
        help="interpreter that has placo (this one, if it has it); without, no row placo",
    )
    arguments = parser.parse_args(argv)
    for tree in (arguments.old, arguments.new):
        if not (tree / "pyproject.toml").is_file():
            parser.error(f"expected a source tree with a pyproject.toml, got {tree}")
    return arguments


def _record(comparison: Comparison, results: Sequence[Result], builds: Sequence[Build]) -> str:
    """Return everything as JSON."""
    rows = [
        {"group": result.row.group, "title": result.row.title}
        | {key: value for key, value in result._asdict().items() if key != "row"}
        for result in results
    ]
    return json.dumps(
        {
            "machine": f"{platform.machine()}, {os.cpu_count()} cores",
            "load": os.getloadavg(),
            "python": platform.python_version(),
            "builds": {build.name: str(build.root) for build in builds},
            "rounds": {"old": comparison.old, "new": comparison.new},
            "rows": rows,
        },
        indent=1,
    )


def compare(arguments: argparse.Namespace) -> int:
    """Compare and print; returns 0 if every must is kept, else 1.

    Raises:
        ConfigError: a source tree is not what would run.
    """
    rows, rounds = arguments.rows, arguments.rounds
    builds = Build("old", arguments.old.resolve()), Build("new", arguments.new.resolve())
    for build in builds:
        check_tree(build)
    with tempfile.TemporaryDirectory() as folder:
        comparison = Comparison(*builds, rows, arguments.placo_python, Path(folder))
        with ProgressBar("comparing", rounds * comparison.runs) as bar:
            for _ in range(rounds):
                comparison.add_round(bar)
    results = [judge(row, comparison.old, comparison.new) for row in rows]
    print("\n".join(table(results)))
    few = "" if rounds >= ENOUGH else f"; fewer than {ENOUGH} give no figures to quote"
    print(f"{rounds} rounds{few}; {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    if arguments.json:
        arguments.json.write_text(_record(comparison, results, builds), encoding="utf-8")
    return int(any(result.kept is False for result in results))


def main(argv: Sequence[str] | None = None) -> int:
    """Read the options and compare; returns the exit code."""
    arguments = _parse(argv)
    return run_program("compare.py", lambda: compare(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
