"""The folder of a training: its settings, its state, its checkpoints.

    training.json            what is learned from what, by which settings
    estimator.safetensors    the parts that estimate the scene, if there are any
    state.safetensors        weights and optimiser after the last validation, to go on from
    metrics.jsonl            a line for each validation
    curves.png               the same as a picture
    checkpoints/000800       a checkpoint, named by its step
    best, last               links to checkpoints: of the least held-out loss, and the newest

Beside it, the folder ``estimators`` keeps those parts for trainings that would learn the same.
Nothing is ever unpickled.
"""

import json
import shutil
from pathlib import Path
from typing import Self

import numpy as np
import torch
from pydantic import Field, ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from common.errors import explain
from lab.errors import TrainingError
from lab.learning.training.config import TrainingConfig
from lab.learning.training.errors import EstimationErrors
from lab.learning.training.learner import Learner
from lab.trials.folder import disk_errors, read_model, write_file, write_model
from lab.trials.spec import settings_differences
from services.policy.checkpoint.folder import save_checkpoint
from services.policy.checkpoint.manifest import Origin
from services.policy.configuration import PolicySettings, StrictModel
from services.policy.kinds import AnyConfig
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.processor import Processor

SETTINGS, STATE, ESTIMATOR = "training.json", "state.safetensors", "estimator.safetensors"
SHARED = "estimators"
METRICS, CURVES = "metrics.jsonl", "curves.png"
CHECKPOINTS, BEST, LAST = "checkpoints", "best", "last"


class TrainingFile(StrictModel):
    """Content of ``training.json``: all that decides what is learned, but code and machine.

    Attributes:
        task: of the demonstrations.
        dataset: digest of the data set.
        policy: settings of the policy.
        training: settings of training.
    """

    task: str
    dataset: str
    policy: AnyConfig
    training: TrainingConfig

    @classmethod
    def of(cls, task: str, dataset: str, policy: PolicySettings, training: TrainingConfig) -> Self:
        """Return the file of a policy of any kind."""
        return cls.model_validate(
            {
                "task": task,
                "dataset": dataset,
                "policy": policy.model_dump(),
                "training": training.model_dump(),
            }
        )


class Progress(StrictModel):
    """How far a training is.

    Attributes:
        step: steps taken.
        seconds: time that they took [s].
        best_step: step of the best checkpoint.
        best_loss: its loss on held-out episodes; None: there is no checkpoint yet.
    """

    step: int = Field(default=0, ge=0)
    seconds: float = Field(default=0.0, ge=0.0)
    best_step: int = Field(default=0, ge=0)
    best_loss: float | None = None


class TrainingFolder:
    """The folder of a training.

    Attributes:
        root: its path.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def begin(self, file: TrainingFile) -> None:
        """Begin a training, or go on with the one that is there.

        Raises:
            TrainingError: there is another training, or the folder cannot be written.
        """
        with disk_errors(self.root, TrainingError):
            self.root.mkdir(parents=True, exist_ok=True)
        there = read_model(self.root / SETTINGS, TrainingFile, TrainingError)
        if there is None:
            write_model(self.root / SETTINGS, file, TrainingError)
        elif there != file:
            one, other = (f.model_dump(mode="json") for f in (there, file))
            differences = "\n  ".join(settings_differences(one, other))
            raise TrainingError(
                f"{self.root} has a training with other settings; give the same, or choose another "
                f"--out. There | asked for:\n  {differences}"
            )

    def save_estimator(self, parts: nn.Module, errors: EstimationErrors, key: str) -> None:
        """Keep the parts of a network that estimate the scene, and their errors.

        Args:
            parts: of the network.
            errors: of their estimates.
            key: under which other trainings find them.

        Raises:
            TrainingError: they cannot be written.
        """
        about = json.dumps([part.tolist() for part in errors])
        content = save(_on_cpu(parts.state_dict()), {"about": about})
        write_file(self.root / ESTIMATOR, content, TrainingError)
        shared = self._shared(key)
        with disk_errors(shared, TrainingError):
            shared.parent.mkdir(exist_ok=True)
        write_file(shared, content, TrainingError)

    def load_estimator(self, parts: nn.Module, key: str) -> EstimationErrors | None:
        """Read ``parts`` as they were kept here or beside it, and return their errors.

        Returns:
            None: they were not kept.

        Raises:
            TrainingError: the file is damaged.
        """
        found = _read(self.root / ESTIMATOR)
        if found is None:
            if (found := _read(self._shared(key))) is None:
                return None
            write_file(self.root / ESTIMATOR, self._shared(key).read_bytes(), TrainingError)
        tensors, about = found
        parts.load_state_dict(tensors)
        return EstimationErrors(*(np.array(part, np.float32) for part in json.loads(about)))

    def _shared(self, key: str) -> Path:
        return self.root.parent / SHARED / f"{key[:16]}.safetensors"

    def save_state(self, learner: Learner, progress: Progress) -> None:
        """Keep weights and optimiser."""
        tensors = {f"network.{k}": v for k, v in learner.network.state_dict().items()}
        if learner.averaged is not learner.network:
            tensors |= {f"averaged.{k}": v for k, v in learner.averaged.state_dict().items()}
        for number, state in learner.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{number}.{name}": value for name, value in state.items()}
        content = save(_on_cpu(tensors), {"about": progress.model_dump_json()})
        write_file(self.root / STATE, content, TrainingError)

    def progress(self) -> Progress:
        """Return how far :meth:`save_state` was; the first step if it never was.

        Raises:
            TrainingError: the file is damaged.
        """
        path = self.root / STATE
        found = _read(path)
        if found is None:
            return Progress()
        try:
            return Progress.model_validate_json(found[1])
        except ValidationError as error:
            raise TrainingError(f"{path}: {explain(error)}") from error

    def load_state(self, learner: Learner) -> Progress:
        """Go on where :meth:`save_state` was; the first step if it never was.

        Raises:
            TrainingError: the file is damaged.
        """
        progress, found = self.progress(), _read(self.root / STATE)
        if found is None:
            return progress
        tensors, _ = found
        optimiser: dict[int, dict[str, Tensor]] = {}
        parts: dict[str, dict[str, Tensor]] = {"network": {}, "averaged": {}}
        for name, tensor in tensors.items():
            part, _, rest = name.partition(".")
            if part == "optimiser":
                number, _, key = rest.partition(".")
                optimiser.setdefault(int(number), {})[key] = tensor
            else:
                parts[part][rest] = tensor
        learner.network.load_state_dict(parts["network"])
        if learner.averaged is not learner.network:
            learner.averaged.load_state_dict(parts["averaged"])
        groups = learner.optimiser.state_dict()["param_groups"]
        learner.optimiser.load_state_dict({"state": optimiser, "param_groups": groups})
        return progress

    def save_checkpoint(
        self, network: PolicyNetwork, processor: Processor, origin: Origin, progress: Progress
    ) -> None:
        """Write the checkpoint of a step, point the links to it, and remove those without one.

        Raises:
            CheckpointError: it cannot be written.
            TrainingError: a link cannot be.
        """
        folder = self.root / CHECKPOINTS
        path = folder / f"{progress.step:06d}"
        with disk_errors(path, TrainingError):
            # One that was written before the training was killed, and is learned anew.
            shutil.rmtree(path, ignore_errors=True)
            save_checkpoint(path, network, processor, origin)
            best = folder / f"{progress.best_step:06d}"
            for name, target in ((BEST, best), (LAST, path)):
                temporary = self.root / f"{name}.part"
                temporary.unlink(missing_ok=True)
                temporary.symlink_to(target.relative_to(self.root))
                temporary.replace(self.root / name)
            for other in folder.iterdir():
                if other.name not in {best.name, path.name}:
                    shutil.rmtree(other)


def _on_cpu(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}


def _read(path: Path) -> tuple[dict[str, Tensor], str] | None:
    """Return the tensors of a file and what it says about them; None: there is no file."""
    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            about = (file.metadata() or {}).get("about", "")
    except (OSError, SafetensorError) as error:
        raise TrainingError(
            f"cannot read {path}: {error}; it is damaged, remove it to begin anew"
        ) from error
    if not all(bool(torch.isfinite(tensor).all()) for tensor in tensors.values()):
        raise TrainingError(f"expected finite numbers in {path}; remove it to begin anew")
    return tensors, about
