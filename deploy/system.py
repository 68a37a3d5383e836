"""The processes that make up a system, and the directory of a run."""

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from common.errors import ConfigError
from common.transport.config import PORT_TABLE, BusConfig, read_config_file
from deploy.errors import DeployError
from deploy.process import ProcessSpec

RUNS = Path("runs")
"""Directory of all runs, below the current directory."""
LOG_FILE = "log.mcap"
DEFAULT_TORQUE_MODE = "relaxed"
"""Of plant and controller, where neither option nor configuration says."""
OPERATOR = "teleop"
"""Name of the operator's process."""

# The plant stops first: without commands it would hold, go limp and be recorded falling. The
# logger stops last, so that the log holds the end of all others.
_FIRST, _THEN, _LAST = 0, 1, 2


@dataclass(frozen=True)
class SystemOptions:
    """Options of the robot's side of a system.

    Attributes:
        torque_mode: torque limits, ``relaxed`` (as the public TRILL simulation) or ``rated`` (the
            URDF's); None: those of the configuration, ``relaxed`` if it has none.
        cameras: whether the cameras run.
        record: whether a logger records everything.
        config: TOML file with the settings of all services, or None.
        restart: whether a service that fails is started again.
        links: injected delays, as the text of TRILL_LINKS.
        task: scored task of the plant; None: flat ground.
        seed: seed of sensor noise and the task's start; None: that of the configuration, or 0.
    """

    torque_mode: str | None = None
    cameras: bool = True
    record: bool = True
    config: Path | None = None
    restart: bool = False
    links: str = ""
    task: str | None = None
    seed: int | None = None


def robot_processes(options: SystemOptions, run_dir: Path) -> list[ProcessSpec]:
    """Declare the robot's side: router, logger, plant, cameras and controller."""
    limits = _option("--torque-mode", options.torque_mode)
    seed = None if options.seed is None else str(options.seed)
    # A plant that is restarted comes up stopped again.
    latch = ("--latch-file", str(run_dir / "estop.json"))
    plant = (*limits, *_option("--seed", seed), *_option("--task", options.task), *latch)
    return [
        ProcessSpec(
            "router",
            "deploy.router",
            restart=options.restart,
            # The robot walks without it; only clients from other machines need it.
            essential=False,
            stop_order=_LAST,
        ),
        ProcessSpec(
            "logger",
            "services.logger",
            ("--out", str(run_dir)),
            options.restart,
            enabled=options.record,
            stop_order=_LAST,
        ),
        ProcessSpec("sim", "services.sim", plant, options.restart, stop_order=_FIRST),
        ProcessSpec(
            "cameras",
            "services.sim.rendering.cameras",
            restart=options.restart,
            enabled=options.cameras,
            essential=False,
            stop_order=_THEN,
        ),
        ProcessSpec(
            "wbc",
            "services.wbc",
            limits,
            options.restart,
            # Without commands the plant holds the robot, and lets it go limp after 5 s.
            spare=True,
            stop_order=_THEN,
        ),
    ]


def check_torque_limits(options: SystemOptions) -> None:
    """Refuse a configuration in which plant and controller have different torque limits.

    Raises:
        ConfigError: they differ, or the file cannot be read.
    """
    path = options.config or os.environ.get("TRILL_CONFIG")
    if options.torque_mode is not None or not path:
        return
    tables = read_config_file(Path(path), also=["sim", "wbc"])
    controller = tables.get("wbc", {})
    plant = tables.get("sim", {}).get("torque_mode", DEFAULT_TORQUE_MODE)
    limits = controller.get("limits", {})
    planned = limits.get("torque_mode", controller.get("torque_mode", DEFAULT_TORQUE_MODE))
    if plant != planned:
        raise ConfigError(
            f"{path}: the plant's torque limits, [sim] torque_mode, are {plant}, the controller's, "
            f"[wbc] torque_mode, are {planned}; expected the same: the robot would fall. Set both, "
            "or give --torque-mode"
        )


def _option(name: str, value: str | None) -> tuple[str, ...]:
    """Return a command-line option; nothing where a configuration file is to decide."""
    return () if value is None else (name, value)


def operator_process(*args: str, foreground: bool = False) -> ProcessSpec:
    """Declare the operator, ``python -m services.teleop`` with ``args``.

    With ``foreground`` it owns this terminal, as the keyboard operator must.
    """
    return ProcessSpec(
        OPERATOR,
        "services.teleop",
        args,
        foreground=foreground,
        may_finish=True,
        stop_order=_FIRST,
    )


def headset_process(*args: str) -> ProcessSpec:
    """Declare the operator in a browser or a headset; ``args`` say where its page is served."""
    return ProcessSpec(
        "headset",
        "services.teleop",
        ("headset", *args),
        restart=True,
        # The robot balances without it, and another operator may take it.
        essential=False,
        stop_order=_FIRST,
    )


def policy_process(checkpoint: Path, *options: str) -> ProcessSpec:
    """Declare a policy that operates the robot whenever nobody else does.

    Args:
        checkpoint: its folder.
        options: of ``python -m services.policy``, for instance ``--remote``.
    """
    return ProcessSpec(
        "policy",
        "services.policy",
        (str(checkpoint), "--stay", *options),
        restart=True,
        # A person may take the robot without it.
        essential=False,
        stop_order=_FIRST,
    )


def environment(bus: BusConfig, config: Path | None, links: str = "") -> dict[str, str]:
    """Return the variables that make all processes of one system use the same bus and links.

    They say everything by which a process could join another system, so that neither the shell's
    variables nor the file decide about it.
    """
    variables = {
        "TRILL_ROBOT": bus.robot,
        "TRILL_MODE": bus.mode,
        "TRILL_HOST": bus.host,
        "TRILL_BASE_PORT": str(bus.base_port),
        "TRILL_LISTEN": PORT_TABLE,
        "TRILL_CONNECT": PORT_TABLE,
    }
    if links:
        variables["TRILL_LINKS"] = links
    if config is not None:
        variables["TRILL_CONFIG"] = str(config.resolve())
    return variables


def new_run_dir(root: Path = RUNS) -> Path:
    """Make ``<root>/<date-time>``, with a suffix if two runs start in one second.

    Raises:
        DeployError: the directory cannot be made.
    """
    stamp = time.strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{number}" for number in range(2, 100))):
        path = root / f"{stamp}{suffix}"
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if not root.is_dir():
                raise DeployError(f"{root} exists and is not a directory; move it away") from None
            continue
        except OSError as error:
            raise DeployError(
                f"cannot make the run directory {path}: {error.strerror}; start from a directory "
                "you may write to"
            ) from error
        return path
    raise DeployError(f"too many runs at {stamp} in {root}")


def terminal() -> bool:
    """Return whether this process's input and output are a terminal."""
    return sys.stdin.isatty() and sys.stdout.isatty()
