"""Which processes make up the system, and where a run leaves its files."""

import os
import platform
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from deploy.errors import DeployError
from deploy.process import ProcessSpec, Restart

RUNS = Path("runs")
"""Where runs are kept, below the current directory."""
LOG_FILE = "log.mcap"
OPERATOR = "teleop"
"""The operator's process."""
PACKAGES = ("trill", "eclipse-zenoh", "numpy", "pydantic", "mujoco", "pin", "osqp", "daqp")

# The plant stops first: without commands it would hold, go limp and be seen falling. The logger
# stops last, so that the log has the end of all others.
_FIRST, _THEN, _LAST = 0, 1, 2


@dataclass(frozen=True)
class SystemOptions:
    """What the person who starts the system chose.

    Attributes:
        mode: torque limits, ``relaxed`` (as the public TRILL simulation) or ``rated`` (the URDF's).
        cameras: whether the robot sees.
        record: whether everything is logged.
        config: TOML file for the whole stack, or None.
        restart: what happens to a service that fails.
        links: injected delays, as the text of TRILL_LINKS.
        task: scored task of the plant; None: flat ground.
        seed: of sensor noise and the task's start.
    """

    mode: str = "relaxed"
    cameras: bool = True
    record: bool = True
    config: Path | None = None
    restart: Restart = Restart.NEVER
    links: str = ""
    task: str | None = None
    seed: int = 0


def robot_processes(options: SystemOptions, run_dir: Path) -> list[ProcessSpec]:
    """The robot's side: router, logger, plant, cameras, controller."""
    limits = ("--torque-mode", options.mode)
    plant: tuple[str, ...] = (*limits, "--seed", str(options.seed))
    if options.task is not None:
        plant = (*plant, "--task", options.task)
    return [
        ProcessSpec(
            "router",
            "deploy.router",
            restart=options.restart,
            # The robot walks without; only whoever watches or drives from afar needs it.
            essential=False,
            stop_order=_LAST,
        ),
        ProcessSpec(
            "logger",
            "services.logger",
            ("--out", str(run_dir)),
            options.restart,
            wanted=options.record,
            stop_order=_LAST,
        ),
        ProcessSpec("sim", "services.sim", plant, options.restart, stop_order=_FIRST),
        ProcessSpec(
            "cameras",
            "services.sim.rendering.cameras",
            restart=options.restart,
            wanted=options.cameras,
            essential=False,
            stop_order=_THEN,
        ),
        ProcessSpec("wbc", "services.wbc", limits, options.restart, stop_order=_THEN),
    ]


def scripted_operator(script: str) -> ProcessSpec:
    """An operator that plays ``script`` and ends."""
    return ProcessSpec(
        OPERATOR,
        "services.teleop",
        ("scripted", "--script", script),
        may_finish=True,
        stop_order=_FIRST,
    )


def synthetic_operator(task: str, seed: int) -> ProcessSpec:
    """An operator that does ``task`` like a person with a headset, then holds on."""
    return ProcessSpec(
        OPERATOR,
        "services.teleop",
        ("synthetic", "--task", task, "--seed", str(seed), "--stay"),
        may_finish=True,
        stop_order=_FIRST,
    )


def keyboard_operator() -> ProcessSpec:
    """A person at this terminal."""
    return ProcessSpec(
        OPERATOR,
        "services.teleop",
        ("keyboard",),
        foreground=True,
        may_finish=True,
        stop_order=_FIRST,
    )


def environment(base_port: int, config: Path | None, links: str = "") -> dict[str, str]:
    """Variables that bring all processes of one system together."""
    variables = {"TRILL_BASE_PORT": str(base_port)}
    if links:
        variables["TRILL_LINKS"] = links
    if config is not None:
        variables["TRILL_CONFIG"] = str(config.resolve())
    return variables


def new_run_dir(root: Path = RUNS) -> Path:
    """Make ``<root>/<date-time>``, with a suffix if two runs start in one second.

    Raises:
        DeployError: it cannot be made.
    """
    stamp = time.strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{number}" for number in range(2, 100))):
        path = root / f"{stamp}{suffix}"
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if not root.is_dir():
                raise DeployError(f"{root} is in the way: it is no directory") from None
            continue
        except OSError as error:
            raise DeployError(
                f"cannot make the run directory {path}: {error.strerror}; start from a directory "
                "you may write to"
            ) from error
        return path
    raise DeployError(f"too many runs at {stamp} in {root}")


def versions() -> dict[str, str]:
    """Versions and machine, for the record."""
    found = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpus": str(os.cpu_count()),
    }
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    commit = _commit()
    return found | ({"commit": commit} if commit else {})


def _commit() -> str:
    """Short hash of the source tree's commit; empty outside a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return ended.stdout.strip()


def terminal() -> bool:
    """Whether a person is at this process's input and output."""
    return sys.stdin.isatty() and sys.stdout.isatty()
