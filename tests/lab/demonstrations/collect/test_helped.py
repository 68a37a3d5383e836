"""A policy that does not get on is helped: one real trial, with the marks of who acted."""

import io
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from common.errors import ConfigError
from common.schemas import OperatorKind
from lab.demonstrations.collect.check import check
from lab.demonstrations.collect.config import EpisodeConfig
from lab.demonstrations.collect.episode import UNAIDED, _meta, make_episode
from lab.demonstrations.collect.store import DatasetStore
from lab.demonstrations.frames import EpisodeFrames
from lab.learning.evaluation.plan import constant, policy_spec
from lab.learning.training.demonstrations import read_demonstrations
from lab.trials.operators.specs import HelpedSpec
from lab.trials.spec import TrialResult
from services.teleop.synthetic.take_over import TakeOver
from tests.lab.demonstrations.collect.support import CODE
from tests.services.policy.served import BLIND, saved

pytest.importorskip("torch")


def helped(checkpoint: Path, latest: float | None) -> EpisodeConfig:
    from services.policy.checkpoint.manifest import describe

    spec = policy_spec(checkpoint, describe(checkpoint), {})
    operator = HelpedSpec(policy=constant(spec), take_over=TakeOver(stalled=60.0, latest=latest))
    return EpisodeConfig(
        task="door/unlock", physics_steps=5, pictures=None, operator=operator, keep_failures=True
    )


def test_who_acted_is_marked_and_what_the_helper_did_can_be_learned(tmp_path: Path) -> None:
    config = helped(saved(tmp_path / "policy", BLIND), latest=0.2)
    made = make_episode(config, seed=0)
    assert (made.meta.verdict, made.meta.operator) == ("success", "mixed"), made.meta.reason
    assert made.content is not None
    store = DatasetStore(tmp_path / "set")
    with store.writing(config, CODE):
        store.add(made.meta, made.content)
    assert check(store) == []
    with h5py.File(io.BytesIO(made.content)) as file:
        acts = file["intervention"][:]
        (first,) = np.flatnonzero(np.diff(acts)) + 1
        assert acts[first:].all()
        assert 3 < first < 15
        assert (np.diff(file["time/robot_ns"][:]) == 50_000_000).all()
    copy = shutil.copytree(tmp_path / "set", tmp_path / "copy")
    shown = read_demonstrations([tmp_path / "set", copy], "door/unlock")
    assert [d.first for d in shown] == [first, first]


def test_a_policy_that_needed_no_help_makes_no_success(tmp_path: Path) -> None:
    config = helped(saved(tmp_path / "policy", BLIND), latest=None)
    result = TrialResult(task="door/unlock", seed=3, verdict="success", time=6.0, reason="done")
    frames: EpisodeFrames[int] = EpisodeFrames()
    frames.operators.add(OperatorKind.POLICY)
    recorder: Any = SimpleNamespace(frames=frames, verdict_frame=-1)
    meta = _meta(config, recorder, result)
    assert (meta.verdict, meta.operator, meta.success) == (UNAIDED, "policy", False)
    frames.operators.add(OperatorKind.SCRIPT)
    assert _meta(config, recorder, result).verdict == "success"


def test_links_of_the_policy_alone_are_refused(tmp_path: Path) -> None:
    config = helped(saved(tmp_path / "policy", BLIND), latest=None)
    with pytest.raises(ConfigError, match="expected links of all services"):
        EpisodeConfig.checked({**config.model_dump(), "links": {"policy:camera": "80ms"}})
