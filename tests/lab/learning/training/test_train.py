"""A training from a data set to a checkpoint: what is learned, kept, and gone on with."""

import json
import subprocess
import sys
from dataclasses import replace
from math import log, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lab.errors import TrainingError
from lab.learning.training.config import TrainingConfig, ViewsConfig
from lab.learning.training.events import EVENTS
from lab.learning.training.folder import BEST, LAST, METRICS, STATE
from lab.learning.training.learner import Learner, mixed_precision
from lab.learning.training.train import train
from lab.learning.training.views import Views
from services.policy.checkpoint.folder import load_checkpoint
from services.policy.configuration import InputConfig, LossConfig
from services.sim.errors import RenderingUnavailableError
from tests.lab.learning.training.support import PICTURE, SCENE, blind, dataset, job
from tests.services.policy.made import small


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("data") / "set")


def weights(out: Path, name: str = LAST) -> dict[str, torch.Tensor]:
    network, _ = load_checkpoint(out / name)
    return dict(network.state_dict())


def metrics(out: Path) -> list[dict[str, Any]]:
    found = [json.loads(line) for line in (out / METRICS).read_text().splitlines()]
    for line in found:
        del line["seconds"]
    return found


def assert_same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> None:
    assert one.keys() == other.keys()
    for name, tensor in one.items():
        assert torch.equal(tensor, other[name]), name


def test_four_demonstrations_are_learned_by_heart(data: Path, tmp_path: Path) -> None:
    told = blind(
        inputs=InputConfig(vision="blind", scene=SCENE, previous_setpoint=True),
        loss=LossConfig(hands=0.1),
    )
    changes = {"steps": 300, "batch": 16, "window": 10, "validate_every": 100, "rate": 0.02}
    train(job(data, tmp_path, told, **changes))
    learned = metrics(tmp_path)[-1]["train"]
    # The least loss there is: no error, and the least standard deviation, in all 14 numbers.
    floor = 14 * (log(0.1) + 0.5 * log(2.0 * pi))
    assert floor < learned["hands"] < floor + 1.0
    assert learned["grasp"] < 0.05
    assert learned["trigger"] + learned["gait"] < 0.05


def test_a_stopped_training_goes_on_as_if_it_had_not_been(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    averaging: dict[str, Any] = {"steps": 9, "average": 0.9, "weight_decay": 1e-3}
    train(job(data, whole, **averaging))
    learn, taken = Learner.learn, 0

    def until_killed(self: Learner, *arguments: Any) -> Any:
        nonlocal taken
        taken += 1
        if taken == 8:
            raise KeyboardInterrupt
        return learn(self, *arguments)

    monkeypatch.setattr(Learner, "learn", until_killed)
    with pytest.raises(KeyboardInterrupt):
        train(job(data, broken, **averaging))
    train(job(data, broken, **averaging))
    # The two steps after the last validation were taken twice.
    assert taken == 11
    assert metrics(broken) == metrics(whole)
    for name in (BEST, LAST):
        assert_same(weights(broken, name), weights(whole, name))


def test_best_is_the_least_loss_on_held_out_episodes(data: Path, tmp_path: Path) -> None:
    done = train(job(data, tmp_path, steps=60, rate=0.1, schedule="constant", clip=0.0))
    losses = {line["step"]: line["held_out"]["loss"] for line in metrics(tmp_path)}
    assert done.best_step == min(losses, key=lambda step: losses[step])
    assert done.best_step < done.step == 60
    names = {path.name for path in (tmp_path / "checkpoints").iterdir()}
    assert names == {f"{done.best_step:06d}", "000060"}
    assert (tmp_path / BEST).resolve().name == f"{done.best_step:06d}"
    assert (tmp_path / LAST).resolve().name == "000060"


def test_only_the_first_demonstrations_are_learned_from(data: Path, tmp_path: Path) -> None:
    train(replace(job(data, tmp_path / "three"), episodes=3))
    train(job(dataset(tmp_path / "data", 3), tmp_path / "same"))
    assert metrics(tmp_path / "three") == metrics(tmp_path / "same")
    with pytest.raises(TrainingError, match=r"expected 6 successful episodes in .*, got 5"):
        train(replace(job(data, tmp_path / "six"), episodes=6))


def test_what_is_learned_is_not_read_again(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = train(job(data, tmp_path))
    monkeypatch.setattr("lab.learning.training.train._windows", lambda *_: pytest.fail("read"))
    assert train(job(data, tmp_path)) == done


def test_an_estimator_is_learned_once_for_all_kinds(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit by bit the same is shared as would have been learned alone."""
    rendered = []

    def views(*arguments: Any) -> Views:
        rendered.append(arguments)
        return invented(arguments[2], arguments[5], arguments[6])

    monkeypatch.setattr("lab.learning.training.train.render_views", views)
    inputs = InputConfig(picture_size=(24, 18), joint_state=False, estimated=SCENE)
    few = {"views": ViewsConfig(count=100, held_out=20, steps=3, batch=4)}
    for folder, kind, renderings in (("both", "trill", 2), ("both", "bc", 2), ("alone", "bc", 4)):
        policy = small(kind, inputs=inputs)
        train(job(data, tmp_path / folder / kind, policy, **few))
        assert len(rendered) == renderings, (folder, kind)
    assert_same(weights(tmp_path / "both" / "bc"), weights(tmp_path / "alone" / "bc"))
    assert metrics(tmp_path / "both" / "bc") == metrics(tmp_path / "alone" / "bc")
    # Other views, another estimator.
    few = {"views": ViewsConfig(count=101, held_out=20, steps=3, batch=4)}
    train(job(data, tmp_path / "both" / "other", small("bc", inputs=inputs), **few))
    assert len(rendered) == 6


def invented(inputs: InputConfig, count: int, rng: np.random.Generator) -> Views:
    """Return views without a renderer."""
    width, height = inputs.picture_size
    pictures = rng.integers(0, 255, (count, 2, height, width, 3), dtype=np.uint8)
    labels = rng.normal(size=(count, len(inputs.estimated)))
    return Views(pictures, labels, np.zeros((count, 2, 0, 2)))


def test_a_checkpoint_says_where_it_comes_from(data: Path, tmp_path: Path) -> None:
    train(job(data, tmp_path))
    origin = load_checkpoint(tmp_path / LAST)[1].manifest.origin
    assert (origin.task, origin.operator, origin.episodes) == ("door/unlock", "synthetic", 4)
    assert len(origin.dataset) == len(origin.source) == 64
    assert {"torch", "python"} <= origin.versions.keys()


def test_another_seed_learns_something_else(data: Path, tmp_path: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train(job(data, tmp_path / name, seed=seed))
    assert_same(weights(tmp_path / "a"), weights(tmp_path / "b"))
    assert metrics(tmp_path / "a") != metrics(tmp_path / "c")


def test_minutes_end_a_training(data: Path, tmp_path: Path) -> None:
    done = train(job(data, tmp_path, minutes=1e-3, steps=10**9, validate_every=10**9))
    assert done.seconds >= 0.06
    assert metrics(tmp_path)[-1]["step"] == done.step


def test_pictures_are_learned_from(tmp_path: Path) -> None:
    data = dataset(tmp_path / "data", 3, pictures=True)
    seeing = blind(inputs=InputConfig(picture_size=(24, 18), joint_state=False))
    train(job(data, tmp_path / "out", seeing, shift=2))
    network, description = load_checkpoint(tmp_path / "out" / LAST)
    assert description.manifest.origin.picture_size == PICTURE
    assert int(network.encoders["left"].trunk.layers[1].num_batches_tracked) == 6


def test_pictures_that_a_data_set_lacks_are_rendered(data: Path, tmp_path: Path) -> None:
    seeing = blind(inputs=InputConfig(picture_size=(40, 30), joint_state=False))
    try:
        train(job(data, tmp_path, seeing))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    mean = weights(tmp_path)["encoders.left.trunk.layers.1.running_mean"]
    assert float(mean.abs().min()) > 0.0


def test_two_processes_learn_what_one_does(data: Path, tmp_path: Path) -> None:
    alone, together = tmp_path / "alone", tmp_path / "together"
    train(job(data, alone, loss_frames=3, average=0.9))
    command = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    module = ["-m", "tests.lab.learning.training.two_processes", str(data), str(together)]
    done = subprocess.run(
        [sys.executable, *command, *module], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for one, two in zip(metrics(alone), metrics(together), strict=True):
        assert one["step"] == two["step"]
        for part in ("train", "held_out"):
            assert two[part] == pytest.approx(one[part], rel=1e-4, abs=1e-5)
    for name, tensor in weights(alone).items():
        torch.testing.assert_close(weights(together)[name], tensor, atol=1e-4, rtol=1e-4)


def test_tensorboard_reads_the_metrics(data: Path, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard", reason="needs the extra tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    train(job(data, tmp_path))
    events = EventAccumulator(str(tmp_path / EVENTS))
    events.Reload()
    for line in metrics(tmp_path):
        for part in ("train", "held_out"):
            for name, value in line[part].items():
                found = {e.step: e.value for e in events.Scalars(f"{part}/{name}")}
                assert found[line["step"]] == pytest.approx(value, rel=1e-6)


def test_16_bits_learn_about_the_same_and_are_not_kept(tmp_path: Path) -> None:
    data = dataset(tmp_path / "data", 3, pictures=True)
    seeing = blind(inputs=InputConfig(picture_size=(24, 18), joint_state=False))
    found = []
    for precision in ("float32", "bfloat16"):
        train(job(data, tmp_path / precision, seeing, precision=precision))
        found.append(metrics(tmp_path / precision)[0]["train"]["hands"])
        assert {tensor.dtype for tensor in weights(tmp_path / precision).values()} == {
            torch.float32,
            torch.int64,
        }
    assert found[0] != found[1]
    assert found[0] == pytest.approx(found[1], rel=0.05)


@pytest.mark.parametrize(
    ("amx", "avx512", "looking", "mixed"),
    [
        (False, False, True, False),
        (False, True, True, True),
        (False, True, False, False),
        (True, True, False, True),
    ],
)
def test_16_bits_are_chosen_where_the_processor_gains(
    amx: bool, avx512: bool, looking: bool, mixed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: avx512)
    config, device = TrainingConfig(), torch.device("cpu")
    assert mixed_precision(config, device, looking=looking) is mixed


def test_other_settings_are_refused_in_the_same_folder(data: Path, tmp_path: Path) -> None:
    train(job(data, tmp_path))
    with pytest.raises(TrainingError, match=r"training\.rate: 0\.01 \| 0\.02"):
        train(job(data, tmp_path, rate=0.02))


def test_a_damaged_state_is_refused(data: Path, tmp_path: Path) -> None:
    train(job(data, tmp_path))
    path = tmp_path / STATE
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(TrainingError, match="it is damaged, remove it"):
        train(job(data, tmp_path))


def test_a_loss_that_is_no_number_ends_the_training(data: Path, tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="the learning rate is too high"):
        train(job(data, tmp_path, rate=1e20, schedule="constant", clip=0.0, steps=20))
