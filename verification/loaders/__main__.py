"""``make loaders``: export a data set and load all of it with robomimic and lerobot."""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from common.errors import TrillError
from common.program import run_program
from lab.demonstrations.export import lerobot, robomimic
from lab.demonstrations.export.selection import EpisodeSelection, select_episodes
from lab.errors import DatasetError
from verification.loaders.loaders import LOADERS, Loader, install, python_of, run_check

TEXT = """Export a data set in both formats and load it with the projects' own loaders. Every number
must equal the collected one to the bit, every picture must be the same (30 dB in videos), and
masks, statistics and windows of several frames must be correct. A policy of each project is trained
for a few steps.

Each project is installed into a venv of its own with torch (a CPU build where the package registry
has one, otherwise several GB):

  robomimic-0.3   robomimic 0.3.0, SequenceDataset; BC-RNN          Python 3.11 or 3.12
  lerobot-0.4     lerobot 0.4.4, pictures embedded; ACT             Python 3.11
  lerobot-0.6     lerobot 0.6.1, video (by pyav) and embedded; ACT  Python 3.12

A loader whose Python is not installed is skipped with a message. Exit code: 0 if at least one ran
and all that ran accept the exports."""
EXAMPLES = """examples:
  python -m verification.loaders
  python -m verification.loaders --only robomimic-0.3 --venvs runs/loaders
  python -m verification.loaders --data runs/datasets/door-unlock
"""
_COLLECT = ("--episodes", "2", "--physics-steps", "5", "--width", "200", "--height", "150")


def main() -> int:
    """Run the checks; return the exit code."""
    arguments = _arguments()
    return run_program("loaders", lambda: run(arguments), "stopped")


def run(arguments: argparse.Namespace) -> int:
    """Export and load; return 1 if a loader refuses an export, or none ran."""
    wanted = [one for one in LOADERS if arguments.only in {None, one.name}]
    tried = failed = 0
    with tempfile.TemporaryDirectory(prefix="trill-loaders-") as name:
        scratch = Path(name)
        roots = [root.resolve() for root in arguments.data] or [_collected(scratch)]
        for loader in wanted:
            python = python_of(loader)
            if python is None:
                _report(f"{loader.name}: skipped, needs Python {' or '.join(loader.pythons)}")
                continue
            tried += 1
            venvs = arguments.venvs.resolve() if arguments.venvs else scratch
            failed += not _accepted(loader, python, venvs, roots, scratch)
    _report(f"{tried - failed} of {tried} loaders accept the exports")
    return int(failed > 0 or tried == 0)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.loaders",
        description=TEXT,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--only", choices=[loader.name for loader in LOADERS], help="run this one only"
    )
    parser.add_argument(
        "--data",
        nargs="+",
        type=Path,
        default=[],
        metavar="DIR",
        help="data sets to export (two new episodes)",
    )
    parser.add_argument("--venvs", type=Path, metavar="DIR", help="keep the venvs in this folder")
    return parser.parse_args()


def _report(text: str) -> None:
    print(text, flush=True)


def _collected(scratch: Path) -> Path:
    """Collect two episodes, which takes a minute or two."""
    _report("collecting two episodes")
    root = scratch / "collected"
    command = [sys.executable, "-m", "lab.cli", "collect", "door/unlock", *_COLLECT]
    done = subprocess.run([*command, "--out", str(root)], stdout=subprocess.DEVNULL, check=False)
    if done.returncode:
        raise DatasetError(f"{' '.join(command)} failed; give collected episodes by --data")
    return root


def _accepted(loader: Loader, python: str, venvs: Path, roots: list[Path], scratch: Path) -> bool:
    """Export for a loader and report whether it accepts every export."""
    try:
        interpreter = install(loader, python, venvs / loader.name, _report)
        for number, (title, options) in enumerate(loader.exports.items()):
            out = scratch / f"{loader.name}-{number}{'.hdf5' if loader.form == 'robomimic' else ''}"
            module = robomimic if loader.form == "robomimic" else lerobot
            selection = EpisodeSelection(tuple(roots), columns=options.columns)
            module.write(select_episodes(selection), out, **options.write)
            found = run_check(loader, interpreter, out, roots)
            lines = [line[2:] for line in found.splitlines() if _is_finding(line)]
            _report(f"{loader.name}: {title}\n  " + "\n  ".join(lines))
    except TrillError as error:
        _report(f"{loader.name}: REFUSED: {error}")
        return False
    return True


def _is_finding(line: str) -> bool:
    """Whether a line was printed by the check, not by the project that it runs."""
    return line.startswith("= ")


if __name__ == "__main__":
    raise SystemExit(main())
