"""Physics steps in compiled code and in Python: the same bits, and the same reasons to stop."""

from typing import Any

import mujoco
import numpy as np
import pytest

from common.plant.config import PHYSICS_STEP_NS, TorqueMode
from common.plant.servo import Servo, Target, motor_target
from common.robot.joints import NUM_MOTORS, POSITION_LOWER, POSITION_UPPER
from services.sim.model.world import build_model, build_spec, find_addresses
from services.sim.physics import steps as physics
from services.sim.physics.stance import standing_qpos
from services.sim.physics.steps import PhysicsSteps
from tests.services.sim.support import MS

STAMP = 1000 * MS
needs_kernel = pytest.mark.skipif(physics._steps is None, reason="the kernel is not built")


class Robot:
    """A robot in the physics, in compiled code or not."""

    def __init__(self, model: Any, *, compiled: bool, mode: TorqueMode = TorqueMode.RATED) -> None:
        self.addresses = find_addresses(model)
        self.data = mujoco.MjData(model)
        self.servo = Servo(mode)
        self.steps = PhysicsSteps(model, self.data, self.addresses.torso, self.servo)
        if not compiled:
            self.steps._prepared = None
        self.data.qpos[:] = standing_qpos(model, self.addresses, 0.7, 0.2)
        mujoco.mj_forward(model, self.data)

    def state(self) -> tuple[bytes, bytes, bytes, int]:
        data = self.data
        return (
            data.qpos.tobytes(),
            data.qvel.tobytes(),
            data.ctrl.tobytes(),
            self.servo.saturated_steps,
        )


@pytest.fixture(scope="module")
def model() -> Any:
    # MuJoCo's own handler writes a log file into the working directory.
    mujoco.set_mju_user_warning(lambda text: None)
    return build_model("flat", visuals=False)


def random_target(rng: np.random.Generator, strength: float) -> Target:
    """Return a law around a random posture, a little beyond the limits of the joints."""
    position = rng.uniform(POSITION_LOWER - 0.02, POSITION_UPPER + 0.02)
    velocity, acceleration, torque = strength * rng.normal(size=(3, 27))
    return motor_target(
        STAMP,
        position,
        velocity,
        10.0 * acceleration,
        10.0 * torque,
        rng.uniform(0.0, 100.0 * strength, 27),
        rng.uniform(0.0, 3.0, 27),
    )


@needs_kernel
@pytest.mark.parametrize("mode", list(TorqueMode))
def test_compiled_steps_are_those_of_python(model: Any, mode: TorqueMode) -> None:
    rng = np.random.default_rng(5)
    one, other = (Robot(model, compiled=compiled, mode=mode) for compiled in (True, False))
    assert one.steps._prepared is not None
    free = saturated = 0
    for case in range(100):
        target = random_target(rng, strength=[0.1, 1.0, 10.0][case % 3])
        qpos = one.data.qpos.copy()
        addresses = one.addresses.qpos
        qpos[addresses] = rng.uniform(POSITION_LOWER - 0.03, POSITION_UPPER + 0.03)
        qvel = rng.normal(size=one.data.qvel.shape)
        now = STAMP + int(rng.integers(-5, 40)) * MS
        before = one.servo.saturated_steps
        for robot in (one, other):
            robot.data.qpos[:], robot.data.qvel[:] = qpos, qvel
            assert robot.steps.run(target, now, 3, watch_fall=False) == (3, False)
        assert one.state() == other.state()
        saturated += one.servo.saturated_steps > before
        free += one.servo.saturated_steps == before
    assert min(free, saturated) > 5, "both branches were seen"


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_kernel), False])
def test_steps_end_where_the_state_is_worth_a_look(model: Any, compiled: bool) -> None:
    limp = Target(STAMP, np.zeros((5, NUM_MOTORS)))
    robot = Robot(model, compiled=compiled)
    assert robot.steps.run(limp, STAMP, 7, watch_fall=True) == (7, False)
    steps, is_notable = robot.steps.run(limp, STAMP, 5000, watch_fall=True)
    assert robot.steps.is_down()
    assert is_notable
    assert 100 < steps < 1000
    assert robot.steps.run(limp, STAMP, 7, watch_fall=False) == (7, False)
    robot.data.qvel[0] = np.nan
    assert robot.steps.run(limp, STAMP, 7, watch_fall=False) == (1, True)


def test_a_fall_ends_the_steps_in_the_same_step_either_way(model: Any) -> None:
    falls = []
    for compiled in (True, False):
        robot = Robot(model, compiled=compiled)
        limp = Target(STAMP, np.zeros((5, NUM_MOTORS)))
        singly = 0
        while not robot.steps.is_down():
            now = STAMP + singly * PHYSICS_STEP_NS
            singly += robot.steps.run(limp, now, 1 if compiled else 5000, watch_fall=True)[0]
        falls.append(singly)
    assert falls[0] == falls[1]


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_kernel), False])
def test_a_fatal_error_of_mujoco_is_an_exception(compiled: bool) -> None:
    spec = build_spec("flat", visuals=False)
    spec.memory = 40_000
    robot = Robot(spec.compile(), compiled=compiled)
    with pytest.raises(mujoco.FatalError, match="out of memory"):
        robot.steps.run(Target(STAMP, np.zeros((5, NUM_MOTORS))), STAMP, 5, watch_fall=True)
