"""The kernel that reads the model's terms from pinocchio's memory, against pinocchio itself."""

import numpy as np
import pinocchio as pin
import pytest

from common.native import kernel
from common.robot import frames
from services.wbc.errors import ModelError
from services.wbc.layout import NV
from services.wbc.model_terms import CompiledTerms, PinocchioTerms, make_terms
from services.wbc.robot_model import RobotModel

from .support import Array

compiled = kernel("services.wbc._model_terms")
needs_kernel = pytest.mark.skipif(
    compiled is None, reason="the kernel is not built; python hatch_build.py builds it"
)


def _passes(model: pin.Model, seed: int) -> tuple[pin.Data, Array, Array]:
    rng = np.random.default_rng(seed)
    data, q, v = model.createData(), pin.neutral(model), rng.normal(size=NV)
    q[:3], q[7:] = rng.normal(size=3), rng.uniform(-1.5, 1.5, size=25)
    q[3:7] = rng.normal(size=4)
    q[3:7] /= np.linalg.norm(q[3:7])
    _run(model, data, q, v)
    return data, q, v


def _run(model: pin.Model, data: pin.Data, q: Array, v: Array) -> None:
    pin.crba(model, data, q, pin.Convention.WORLD)
    pin.nonLinearEffects(model, data, q, v)


@needs_kernel
def test_the_terms_are_pinocchios(model: RobotModel) -> None:
    merged = model.merged
    data = merged.createData()
    assert compiled is not None
    ours = CompiledTerms(merged, data, compiled)
    for seed in range(20):
        _, q, v = _passes(merged, seed)
        _run(merged, data, q, v)
        found, expected = ours.read(q, v), PinocchioTerms(merged, data).read(q, v)
        for name, value, reference in zip(found._fields, found, expected, strict=True):
            scale = 1.0 + np.abs(reference).max()
            assert np.abs(value - reference).max() < 1e-13 * scale, name


@needs_kernel
def test_an_arrays_size_is_checked(model: RobotModel) -> None:
    data, _, v = _passes(model.merged, 0)
    assert compiled is not None
    terms = CompiledTerms(model.merged, data, compiled)
    with pytest.raises(ValueError, match="v: expected 31 numbers, got 30"):
        terms.read(v, v[:-1].copy())


@needs_kernel
def test_a_frame_that_is_turned_against_its_joint_is_refused(
    model: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    turned = model.merged.copy()
    placement = pin.SE3(pin.utils.rotate("z", 0.1), np.zeros(3))
    joint = turned.getJointId("l_ankle_ie")
    turned.addFrame(pin.Frame("turned", joint, placement, pin.FrameType.OP_FRAME))
    monkeypatch.setattr(frames, "FOOT_FRAMES", {"left": "turned", "right": "r_foot"})
    with pytest.raises(ModelError, match="'turned' is turned against its joint"):
        make_terms(turned, turned.createData())


def test_pinocchio_is_asked_without_the_kernel(
    model: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRILL_NATIVE", "0")
    assert isinstance(make_terms(model.merged, model.merged.createData()), PinocchioTerms)
