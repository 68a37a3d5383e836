"""``make loaders``: exports a data set and lets robomimic and lerobot load all of it."""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from common.errors import TrillError
from lab.demonstrations.export import lerobot, robomimic
from lab.demonstrations.export.selection import EpisodeSelection, ExportInput, select_episodes
from lab.errors import DatasetError
from verification.loaders.loaders import LOADERS, Loader, ask, install, python_of

TEXT = """Export a data set in both formats and let the projects' own loaders load it: every number
must be the collected one to the bit, every picture the same (in videos: 30 dB and more), masks,
statistics and windows of several frames right; and a few steps of a policy of theirs are trained.

Each project goes into a venv of its own, away from this one, with torch (a CPU build where the
package registry has one, otherwise several GB):

  robomimic-0.3   robomimic 0.3.0, SequenceDataset; BC-RNN          Python 3.11 or 3.12
  lerobot-0.4     lerobot 0.4.4, pictures embedded; ACT             Python 3.11
  lerobot-0.6     lerobot 0.6.1, video (by pyav) and embedded; ACT  Python 3.12

What needs a Python that is not here is left out, and said. Exit code: 0 if all that was tried is
right, and something was."""
EXAMPLES = """examples:
  python -m verification.loaders
  python -m verification.loaders --only robomimic-0.3 --venvs runs/loaders
  python -m verification.loaders --data runs/datasets/door-unlock
"""
_COLLECT = ("--episodes", "2", "--physics-steps", "5", "--width", "200", "--height", "150")


def main() -> int:
    """Do it; returns the exit code."""
    arguments = _arguments()
    wanted = [one for one in LOADERS if arguments.only in {None, one.name}]
    tried = failed = 0
    try:
        with tempfile.TemporaryDirectory(prefix="trill-loaders-") as name:
            scratch = Path(name)
            roots = [root.resolve() for root in arguments.data] or [_collected(scratch)]
            source = select_episodes(EpisodeSelection(tuple(roots)))
            for loader in wanted:
                python = python_of(loader)
                if python is None:
                    _say(f"{loader.name}: left out, needs Python {' or '.join(loader.pythons)}")
                    continue
                tried += 1
                venvs = arguments.venvs.resolve() if arguments.venvs else scratch
                failed += not _accepted(loader, python, venvs, source, roots, scratch)
    except TrillError as error:
        print(f"trill: {error}", file=sys.stderr)
        return 1
    _say(f"{tried - failed} of {tried} loaders take everything")
    return int(failed > 0 or tried == 0)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.loaders",
        description=TEXT,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", choices=[loader.name for loader in LOADERS], help="one of them")
    parser.add_argument(
        "--data", nargs="+", type=Path, default=[], metavar="DIR", help="data sets (two episodes)"
    )
    parser.add_argument("--venvs", type=Path, metavar="DIR", help="keep the venvs for next time")
    return parser.parse_args()


def _say(text: str) -> None:
    print(text, flush=True)


def _collected(scratch: Path) -> Path:
    """Two episodes made for this; a minute or two."""
    _say("collecting two episodes")
    root = scratch / "collected"
    command = [sys.executable, "-m", "lab.cli", "collect", "door/unlock", *_COLLECT]
    done = subprocess.run([*command, "--out", str(root)], stdout=subprocess.DEVNULL, check=False)
    if done.returncode:
        raise DatasetError(f"{' '.join(command)} failed; give collected episodes by --data")
    return root


def _accepted(
    loader: Loader, python: str, venvs: Path, source: ExportInput, roots: list[Path], scratch: Path
) -> bool:
    """Whether a loader takes every export meant for it."""
    try:
        interpreter = install(loader, python, venvs / loader.name, _say)
        for number, (title, options) in enumerate(loader.exports.items()):
            out = scratch / f"{loader.name}-{number}{'.hdf5' if loader.form == 'robomimic' else ''}"
            write = robomimic.write if loader.form == "robomimic" else lerobot.write
            write(source, out, **options)
            found = ask(loader, interpreter, out, roots)
            lines = [line[2:] for line in found.splitlines() if _is_finding(line)]
            _say(f"{loader.name}: {title}\n  " + "\n  ".join(lines))
    except TrillError as error:
        _say(f"{loader.name}: NOT TAKEN: {error}")
        return False
    return True


def _is_finding(line: str) -> bool:
    """Whether a line is the check's own, not of the project it asks."""
    return line.startswith("= ")


if __name__ == "__main__":
    raise SystemExit(main())
