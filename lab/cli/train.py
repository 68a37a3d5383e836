"""``trill train``: train a policy on a data set of demonstrations."""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.errors import ConfigError
from common.packages import require
from common.tables import overlaid
from lab.cli.collect import DATASETS
from lab.cli.commands import Action
from lab.trials import options

if TYPE_CHECKING:
    from lab.learning.training.recipes import Recipe

POLICIES = Path("runs/policies")
TEXT = """Train a policy on the demonstrations of a task, as `trill collect` makes them.

--policy is the network: trill (LSTM, a mixture for the hands, grippers and gait apart), bc-rnn
(LSTM, one mixture of everything) or bc (no memory, one vector regressed), as in the paper.
--profile is its size: cpu is learned by one processor core in minutes, paper has 26 million
parameters and wants a GPU.
--recipe is how it learns. paper: the next set-point relative to the last one, from pictures to
hands in one network, as published. chunks: the next 20 absolute set-points, without the
demonstrator's pauses; before it learns to act, its encoder learns from rendered views where the
things of the scene are, with the simulator's answers, which a real robot does not have.
--inputs scene tells the policy what a simulator knows of the scene, in place of pictures: it shows
in a minute what can be reached when nothing has to be seen. --inputs blind tells it nothing, which
every other result should be compared with.

Several --data are learned from together. Of an episode in which an operator took over from a policy
only what the operator did is learned, unless training.interventions says otherwise.

A training may be stopped or killed at any moment; the same command continues it, and with --steps
it learns the same as without the break. A falling loss is no evidence that a policy succeeds:
evaluate `best` and `last`.

Exit code: 0 done, 1 not, 2 wrong options, 130 Ctrl-C."""
EXAMPLES = f"""examples:
  trill collect door/unlock --episodes 120 --seed 1000 --physics-steps 5 --link none --no-images
  trill train door/unlock                                from pictures, for a processor core
  trill train door/unlock --inputs scene                 told the scene by the simulator
  trill train door/unlock --recipe paper --profile paper --device cuda
  torchrun --nproc-per-node 2 -m lab.cli train door/unlock --device cuda      on two GPUs
  trill train door/unlock --policy bc --recipe paper --minutes 5
  trill train door/unlock --recipe paper --set policy.inputs.joint_state=false
  trill train door/unlock --data {DATASETS}/late --out {POLICIES}/late
  trill train door/unlock --data {DATASETS}/door-unlock --data {DATASETS}/door-unlock-interventions
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill train``."""
    add = parser.add_argument
    add("task", help="name of the task, as door/unlock; trill tasks lists them")
    add(
        "--data",
        type=Path,
        action="append",
        metavar="DIR",
        help=f"a data set ({DATASETS}/<task>); again for each further one",
    )
    add(
        "--episodes",
        type=options.count,
        metavar="N",
        help="learn from the first N successes of each, by seed (all)",
    )
    add("--out", type=Path, metavar="DIR", help=f"the training ({POLICIES}/<task>-<options>)")
    add("--policy", choices=["trill", "bc-rnn", "bc"], default="trill", help="the network (trill)")
    add("--profile", choices=["cpu", "paper"], default="cpu", help="its size (cpu)")
    add("--recipe", choices=["chunks", "paper"], default="chunks", help="how it learns (chunks)")
    add(
        "--inputs",
        choices=["pictures", "scene", "blind"],
        default="pictures",
        help="what it knows of the scene (pictures)",
    )
    add(
        "--scene",
        default="",
        metavar="NAMES",
        help="objects or numbers of the scene that it is told or estimates, with commas (those of "
        "the task, for instance lever_grip,door_hinge,door_lever of door/unlock; else all)",
    )
    length = parser.add_argument_group("length")
    length.add_argument(
        "--steps", type=options.count, metavar="N", help="gradient steps (recipe's)"
    )
    length.add_argument(
        "--minutes", type=float, metavar="M", help="stop after so long, in place of --steps"
    )
    length.add_argument(
        "--pretrain-views",
        type=options.count,
        metavar="N",
        help="views from which the encoder learns the scene, recipe chunks (3600; door/push: 5000)",
    )
    machine = parser.add_argument_group("machine")
    machine.add_argument("--device", default="cpu", help="of torch: cpu, cuda (cpu)")
    machine.add_argument(
        "--threads", type=options.count, default=1, metavar="N", help="on a processor (1)"
    )
    add("--seed", type=options.seed, default=0, metavar="N", help="of weights and windows (0)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="any setting: policy.inputs.vision=monoscopic, training.rate=0.001; values in JSON, "
        "or text; docs/reference/configuration.md lists them",
    )
    add("--show", action="store_true", help="print all settings as JSON and do nothing")


def run(arguments: argparse.Namespace) -> int:
    """Train, or print the settings; returns 0 or raises an exception of this project."""
    require("trill train", "policy", "torch", "safetensors")
    require("trill train", "collect", "h5py", "mujoco", "cv2")
    from services.sim.errors import TaskError

    try:
        recipe = _recipe(arguments)
    except TaskError as error:
        raise ConfigError(str(error)) from error
    if arguments.show:
        tables = {name: part.model_dump(mode="json") for name, part in recipe._asdict().items()}
        print(json.dumps(tables, indent=1))
        return 0
    return _train(arguments, recipe)


def _train(arguments: argparse.Namespace, recipe: "Recipe") -> int:
    import torch

    from lab.learning.training.folder import BEST, LAST
    from lab.learning.training.train import Job, train

    torch.set_num_threads(arguments.threads)
    try:
        device = torch.device(arguments.device)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(f"torch cannot use --device {arguments.device}: {reason}") from error
    data = tuple(arguments.data or [DATASETS / folder_name(arguments.task)])
    out = arguments.out or POLICIES / training_name(arguments)
    try:
        done = train(Job(arguments.task, data, out, recipe, device, arguments.episodes))
    except KeyboardInterrupt:
        print(f"\nstopped; {out} is kept: the same command continues it", file=sys.stderr)
        raise
    print(f"{out}: {done.step} steps; least loss on held-out episodes at step {done.best_step}")
    for name in (LAST, BEST)[: 1 + (done.best_step != done.step)]:
        print(f"evaluate it: trill eval {out / name}")
    return 0


def training_name(arguments: argparse.Namespace) -> str:
    """Return the name of a training's folder, unless it is given."""
    chosen = (arguments.policy, arguments.profile, arguments.recipe, arguments.inputs)
    size = [str(arguments.episodes)] if arguments.episodes else []
    return "-".join((folder_name(arguments.task), *chosen, *size))


def folder_name(task: str) -> str:
    """Return the name of a task's data set, unless it is given."""
    return task.replace("/", "-")


def _recipe(arguments: argparse.Namespace) -> "Recipe":
    """Return the settings that the options mean."""
    from lab.learning.training.recipes import SCENES, recipe, task_settings
    from lab.learning.training.truth import TruthReader

    scene: tuple[str, ...] = ()
    if arguments.inputs != "blind":
        wanted = tuple(name.strip() for name in arguments.scene.split(",") if name.strip())
        scene = TruthReader(arguments.task).names(wanted or SCENES.get(arguments.task, ()))
    training = {"seed": arguments.seed, "minutes": arguments.minutes}
    if arguments.steps is not None:
        training["steps"] = arguments.steps
    if arguments.pretrain_views is not None:
        training["views"] = {"count": arguments.pretrain_views}
    chunks = arguments.recipe == "chunks"
    own = task_settings(arguments.policy, arguments.task) if chunks else {}
    changes: Mapping[str, Any] = overlaid(own, {"training": training})
    for text in arguments.set:
        changes = overlaid(changes, _setting(text))
    return recipe(
        arguments.policy, arguments.profile, arguments.recipe, arguments.inputs, scene, changes
    )


def _setting(text: str) -> dict[str, Any]:
    """Return ``policy.a.b=1`` as nested tables.

    Raises:
        ConfigError: it is no such text.
    """
    path, equals, value = text.partition("=")
    keys = path.strip().split(".")
    if not equals or keys[0] not in {"policy", "training"} or not all(keys[1:]) or len(keys) < 2:
        raise ConfigError(
            f"expected --set policy.KEY=VALUE or training.KEY=VALUE, got {text!r}; trill train "
            "TASK --show prints all keys"
        )
    try:
        table: Any = json.loads(value)
    except ValueError:
        table = value
    for key in reversed(keys):
        table = {key: table}
    found: dict[str, Any] = table
    return found


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
