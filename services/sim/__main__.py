"""``python -m services.sim``: the simulated plant as a process."""

import sys
from argparse import SUPPRESS, ArgumentParser, Namespace

from common.packages import imports_of
from common.plant.config import TorqueMode
from common.runtime.live.main import run_live
from common.tables import validated

with imports_of("services.sim", "sim"):
    from services.sim.config import TYPICAL_NOISE, SimConfig
    from services.sim.scenes import SCENES
    from services.sim.service import PlantService
    from services.sim.tasks import all_tasks

DESCRIPTION = """Simulate the plant: DRACO 3 in MuJoCo at 1 kHz, behind its motor servo and command
guard. It stands until commands arrive, follows them while they are valid and fresh, holds its
posture when they stop (0.1 s), goes limp when they stay away (5 s), and reports its state at 200 Hz
of robot time. It needs no display; for pictures run services.sim.rendering.cameras beside it."""

_FIELDS = frozenset(SimConfig.model_fields)


def _add_arguments(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("plant", argument_default=SUPPRESS)
    scenes = "; ".join(f"{scene.name}: {scene.doc}" for scene in SCENES.values())
    group.add_argument("--scene", choices=sorted(SCENES), help=f"surroundings ({scenes})")
    group.add_argument(
        "--task",
        metavar="NAME",
        type=lambda text: text or None,
        help=f"scored task, in its own scene ({', '.join(all_tasks())}; empty: none); see trill "
        "tasks",
    )
    group.add_argument(
        "--torque-mode",
        choices=[mode.value for mode in TorqueMode],
        help="torque limits of the motors: relaxed adds 200 N·m to the legs, as the public TRILL "
        "simulation does; rated keeps those of the URDF (default: relaxed)",
    )
    group.add_argument(
        "--com-height", type=float, help="initial CoM above the soles [m] (0.70, rated 0.73)"
    )
    group.add_argument("--state-rate", type=int, help="measured states per second (200)")
    group.add_argument(
        "--seed",
        type=int,
        help="seed of sensor noise and start (0); a reset without a seed takes the next one",
    )
    group.add_argument(
        "--noise",
        choices=["none", "typical"],
        help="noise on the measured state; typical: 2 mm, 2 cm/s, 0.3 deg (none, or the task's)",
    )
    group.add_argument(
        "--latch-file",
        metavar="FILE",
        help="keeps an emergency stop over a restart, unless the configuration file names another "
        "(none)",
    )


def build(arguments: Namespace) -> PlantService:
    """Build the service from its configuration table; options override the table."""
    options = {name: value for name, value in vars(arguments).items() if name in _FIELDS}
    if "noise" in options:
        options["noise"] = TYPICAL_NOISE if options["noise"] == "typical" else {}
    guard = dict(arguments.settings.get("guard", {}))
    if "latch_file" in vars(arguments):
        guard = {"latch_file": arguments.latch_file} | guard
    return PlantService(validated(SimConfig, arguments.settings, options, {"guard": guard}))


def main() -> int:
    """Run the plant until a signal."""
    return run_live(
        build,
        PlantService.name,
        sys.argv[1:],
        add_arguments=_add_arguments,
        description=DESCRIPTION,
    )


if __name__ == "__main__":
    raise SystemExit(main())
