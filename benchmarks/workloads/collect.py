"""Print how fast demonstrations with pictures are collected: the command itself, from its start.

    python benchmarks/workloads/collect.py [--episodes N]

Results: ``per_hour``, episodes by wall time, and ``cpu_s``, CPU time of an episode.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TASK = "door/unlock"


def main() -> int:
    """Collect and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=6, help="successes (6)")
    episodes = parser.parse_args().episodes
    with tempfile.TemporaryDirectory() as folder:
        words = ("lab.cli", "collect", TASK, "--episodes", str(episodes), "--jobs", "2")
        command = [sys.executable, "-m", *words, "--out", str(Path(folder, "episodes"))]
        began = time.monotonic()
        subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, check=True)
        wall = time.monotonic() - began
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    print(json.dumps({"per_hour": 3600.0 * episodes / wall, "cpu_s": cpu / episodes}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
