"""Trains a policy on a data set: from episodes to a checkpoint that can be served."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from lab.errors import TrainingError
from lab.learning.training.demonstrations import (
    Demonstration,
    digest_of,
    divide,
    episode_files,
    in_words,
    read_demonstrations,
)
from lab.learning.training.errors import EstimationErrors
from lab.learning.training.estimator import estimates, estimating_parts, train_estimator
from lab.learning.training.estimator_key import estimator_key
from lab.learning.training.folder import Progress, TrainingFile, TrainingFolder
from lab.learning.training.gaits import train_gaits
from lab.learning.training.learner import Learner
from lab.learning.training.loop import part_done, run_steps
from lab.learning.training.memory import keep_freed_memory
from lab.learning.training.pictures import read_pictures
from lab.learning.training.processes import Processes, together
from lab.learning.training.recipes import Recipe
from lab.learning.training.truth import TRUTH, TruthReader
from lab.learning.training.views import Views, render_views, rendered
from lab.learning.training.windows import Spread, Windows, observation_spread
from lab.progress import ProgressBar
from lab.trials.folder import disk_errors, locked_folder
from lab.trials.provenance import code_version
from services.policy.checkpoint.manifest import Origin
from services.policy.kinds import network as new_network
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.processor import ESTIMATED, Processor
from services.policy.trill.network import TrillNetwork

PACKAGES = ("torch", "safetensors", "numpy", "h5py", "mujoco")
"""Packages whose versions can change what is learned."""
CAMERA_SIZE = (400, 300)
"""Width and height of the robot's cameras, for a data set without pictures [pixels]."""


@dataclass(frozen=True)
class Job:
    """What is to be trained.

    Attributes:
        task: of the demonstrations.
        data: folders of the data sets.
        out: folder of the training.
        recipe: settings of policy and training.
        device: of torch, for instance ``cuda``.
        episodes: how many successful demonstrations it has, the first by seed; None: all.
    """

    task: str
    data: tuple[Path, ...]
    out: Path
    recipe: Recipe
    device: torch.device
    episodes: int | None = None


def train(job: Job) -> Progress:
    """Train, or go on with a training that was stopped; return how far it is.

    Started by ``torchrun``, its processes train one policy together.

    Raises:
        TrainingError: the data set does not fit, the folder has another training, or the loss is
            no number any more.
        EpisodeError: an episode is damaged.
        ProcessorError: the data set lacks what the policy observes.
        RenderingUnavailableError: pictures are to be rendered, and there is no off-screen OpenGL.
    """
    keep_freed_memory()
    with together(job.device) as (processes, device):
        return _train(replace(job, device=device), processes)


def _train(job: Job, processes: Processes) -> Progress:
    policy, config = job.recipe
    files = sum(job.episodes or len(episode_files(root)) for root in job.data)
    with ProgressBar("reading", files) as bar:
        demonstrations = read_demonstrations(
            job.data,
            job.task,
            policy_frames=config.interventions.policy_frames,
            count=job.episodes,
            advance=bar.advance,
        )
        if processes.first:
            bar.say(f"learning from {in_words(demonstrations)}")
    folder, digest = TrainingFolder(job.out), digest_of(demonstrations)
    with locked_folder(job.out, TrainingError) if processes.first else nullcontext():
        with processes.in_turn():
            folder.begin(TrainingFile.of(job.task, digest, policy, config))
        if part_done(config, there := folder.progress()) >= 1.0:
            return there
        learned, held_out = divide(demonstrations, config.held_out, config.seed)
        _tell_scene(job, demonstrations)
        processor = Processor.fit(policy, [d.arrays for d in learned])
        torch.manual_seed(config.seed)
        network = new_network(policy)
        errors = scene = None
        if policy.inputs.estimated:
            key = estimator_key(job.task, digest, policy, config, job.device)
            with processes.in_turn():
                errors = _estimate(job, folder, key, network, processor, (learned, held_out))
            constant = config.noise.estimate * errors.overall
            scene = Spread(constant, 0.5 * constant)
        windows = (
            _windows(job, processor, learned, errors, f"learned-{processes.rank}"),
            _windows(job, processor, held_out, errors, f"held-out-{processes.rank}"),
        )
        spreads = observation_spread(processor, config.noise), scene
        _learn_gaits(job, network, windows, spreads)
        learner = Learner(network, config, job.device, processes)
        origin = _origin(job.task, demonstrations, len({d.path for d in learned}))
        return run_steps(
            learner,
            folder,
            config,
            windows,
            spreads,
            lambda progress: folder.save_checkpoint(learner.averaged, processor, origin, progress),
            processes,
        )


def _tell_scene(job: Job, demonstrations: Sequence[Demonstration]) -> None:
    """Add the numbers of the scene, if there are any, to the columns of each demonstration."""
    inputs = job.recipe.policy.inputs
    columns = {"scene": inputs.scene, ESTIMATED: inputs.estimated}
    if not any(columns.values()):
        return
    for demonstration in demonstrations:
        if not demonstration.arrays[TRUTH[-1]].size:
            raise TrainingError(
                f"{demonstration.path} has no ground truth, by which a policy could be told the "
                "scene or learn to estimate it; train with --recipe paper or --inputs blind, or "
                "without this data set"
            )
    reader = TruthReader(job.task)
    with ProgressBar("scene", len(demonstrations)) as bar:
        for demonstration in demonstrations:
            arrays = demonstration.arrays
            arrays |= {c: reader.numbers(names, arrays) for c, names in columns.items() if names}
            bar.advance()


def _windows(
    job: Job,
    processor: Processor,
    demonstrations: Sequence[Demonstration],
    errors: EstimationErrors | None,
    name: str,
) -> Windows:
    """Return the windows of demonstrations, with pictures if the network is to look at them."""
    inputs = processor.inputs
    pictures = np.empty((sum(d.frames for d in demonstrations), 0, 1, 1, 3), dtype=np.uint8)
    if inputs.cameras and not inputs.estimated:
        path = job.out / f"pictures-{name}.npy"
        render = partial(rendered, TruthReader(job.task), inputs.cameras, CAMERA_SIZE)
        with (
            disk_errors(job.out, TrainingError),
            ProgressBar("pictures", len(demonstrations)) as bar,
        ):
            pictures = read_pictures(demonstrations, inputs, path, render, bar.advance)
    arrays = [d.arrays for d in demonstrations]
    return Windows(processor, arrays, pictures, job.recipe.training, errors, job.device)


def _estimate(
    job: Job,
    folder: TrainingFolder,
    key: str,
    network: PolicyNetwork,
    processor: Processor,
    parts: tuple[Sequence[Demonstration], Sequence[Demonstration]],
) -> EstimationErrors:
    """Train the parts of ``network`` that estimate the scene, freeze them, and return their errors.

    They are those on views of held-out episodes.
    """
    config, estimating = job.recipe.training, estimating_parts(network)
    assert processor.scene is not None
    errors = folder.load_estimator(estimating, key)
    if errors is None:
        learned, held_out = _views(job, *parts)
        with ProgressBar("estimator", config.views.steps) as bar:
            train_estimator(
                network,
                learned,
                processor.scene,
                config,
                job.device,
                lambda step, loss: bar.show(step + 1, text=f"loss {loss:.3f}"),
            )
            truth = processor.scene.normalise(held_out.labels)
            found = estimates(network, held_out, job.device)
            errors = EstimationErrors(truth, found - truth)
            bar.say(_in_words(processor, errors.overall))
        folder.save_estimator(estimating, errors, key)
    for parameter in estimating.parameters():
        parameter.requires_grad_(False)
    return errors


def _learn_gaits(
    job: Job,
    network: PolicyNetwork,
    windows: tuple[Windows, Windows],
    spreads: tuple[Spread, Spread | None],
) -> None:
    """Train the gaits' own network and freeze it, if there is one.

    It is learned anew when a training goes on, to the same weights: that takes seconds.
    """
    if not isinstance(network, TrillNetwork) or network.gait_network is None:
        return
    config = job.recipe.training
    with ProgressBar("gaits", config.gaits.steps) as bar:
        terms = train_gaits(
            network.gait_network.to(job.device),
            *windows,
            spreads,
            config,
            lambda step, loss: bar.show(step, text=f"loss {loss:.3f}"),
        )
        found = ", ".join(f"{name} {value:.3f}" for name, value in terms.items())
        bar.say(f"gaits: loss on held-out episodes {found}")
    for parameter in network.gait_network.parameters():
        parameter.requires_grad_(False)


def _views(
    job: Job, learned: Sequence[Demonstration], held_out: Sequence[Demonstration]
) -> tuple[Views, Views]:
    """Return views of demonstrations that are learned from, and of held-out ones."""
    inputs, config = job.recipe.policy.inputs, job.recipe.training
    reader, size = TruthReader(job.task), learned[0].meta.picture_size or CAMERA_SIZE
    # The generators of the two must not draw alike.
    learning, validating = np.random.SeedSequence(config.seed).spawn(2)
    views = config.views
    with ProgressBar("views", views.count + views.held_out) as bar:
        rng = np.random.default_rng(learning)
        first = render_views(reader, learned, inputs, size, views, views.count, rng, bar.advance)
        rng = np.random.default_rng(validating)
        return first, render_views(
            reader, held_out, inputs, size, views, views.held_out, rng, bar.advance
        )


def _in_words(processor: Processor, error: NDArray[np.float32]) -> str:
    """Say how large the error of the estimates is."""
    assert processor.scene is not None
    named = zip(processor.inputs.estimated, error, processor.scene.scale, strict=True)
    numbers = ", ".join(f"{name} {part * scale:.4f}" for name, part, scale in named)
    return f"the scene is estimated with an error, root mean square on held-out views, of {numbers}"


def _origin(task: str, demonstrations: Sequence[Demonstration], learned: int) -> Origin:
    code = code_version("lab.learning.training.train", packages=PACKAGES)
    sizes = {d.meta.picture_size for d in demonstrations}
    return Origin(
        dataset=digest_of(demonstrations),
        episodes=learned,
        source=code.source,
        versions=code.versions,
        operator=", ".join(sorted({d.meta.operator for d in demonstrations})),
        task=task,
        picture_size=sizes.pop() if len(sizes) == 1 else None,
    )
