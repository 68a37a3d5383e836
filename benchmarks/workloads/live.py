"""Print what cameras and controller of the live system did: ``trill demo`` on two cores.

    python benchmarks/workloads/live.py [--seconds S]

Results: ``camera_hz`` of the slower eye and ``camera_misses``, both from the run's summary;
``rss_mb`` and ``pss_mb``, the most that the controller's process had at one of the looks taken
every half second.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CORES = 2
LOOK_S = 0.5
CONTROLLER = "services.wbc"


def controller_of(system: int) -> int | None:
    """Return the process id of the oldest child of a system that runs the controller."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            words = (folder / "cmdline").read_bytes().decode().split("\0")
        except OSError:  # ended meanwhile
            continue
        parent, started = int(fields[1]), int(fields[19])
        if parent == system and CONTROLLER in words:
            found.append((started, int(folder.name)))
    return min(found)[1] if found else None


def memory(process: int) -> dict[str, float]:
    """Return RSS and PSS of a process [MB]; nothing if it has ended."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
    except OSError:
        return {}
    pairs = re.findall(r"^(Rss|Pss): +(\d+) kB", text, re.MULTILINE)
    return {f"{name.lower()}_mb": 1.024e-3 * int(size) for name, size in pairs}


def run(seconds: float, folder: Path) -> dict[str, float]:
    """Run the demonstration in ``folder``.

    Raises:
        RuntimeError: it fails.
    """
    words = ("lab.cli", "demo", "--headless", "--no-pictures", "--seconds", str(seconds))
    most = {"rss_mb": 0.0, "pss_mb": 0.0}
    with (folder / "output.txt").open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", *words], cwd=folder, stdout=output, stderr=output
        )
        while process.poll() is None:
            if controller := controller_of(process.pid):
                sizes = memory(controller)
                most = {name: max(size, sizes.get(name, 0.0)) for name, size in most.items()}
            time.sleep(LOOK_S)
    if process.returncode:
        raise RuntimeError(f"trill demo: {(folder / 'output.txt').read_text()}")
    summary = json.loads(next(folder.glob("runs/*/summary.json")).read_text())
    rates = [summary["topics"][f"camera/{eye}"]["rate"] for eye in ("left", "right")]
    misses = summary["services"]["cameras"]["deadline_misses"]
    return {"camera_hz": min(rates), "camera_misses": misses, **most}


def main() -> int:
    """Run and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of the demonstration (30)")
    seconds = parser.parse_args().seconds
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(run(seconds, Path(folder))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
