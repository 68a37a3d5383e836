"""A robot without physics that does exactly what locomotion tells it."""

import numpy as np

from common.robot.rotations import matrix_from_yaw, yaw_from_matrix
from common.schemas import ControlState, Gait, GaitOutcome
from services.wbc.config import WbcConfig
from services.wbc.locomotion import Answer, Locomotion
from services.wbc.references import BodyReference
from services.wbc.robot_model import Dynamics, RobotModel, RobotState

from .support import Array, nominal_state

LONGEST = 10.0
"""No gait takes longer [s]."""


class IdealRobot:
    """A locomotion state machine and a robot that does exactly what it is told, at 100 Hz.

    Attributes:
        feet: (position, yaw) of both soles in world.
        com, com_velocity: as measured; the CoM then follows its reference.
        noise: of the measured feet, standard deviation [m] and [rad].
        foot_force: measured normal forces [N].
        trace: time, discrete state and references of every tick.
        answers: every answer so far.
    """

    def __init__(self, model: RobotModel, config: WbcConfig, ground: float = 0.0) -> None:
        self.locomotion = Locomotion(config)
        self.time = 5.0
        self.feet = [(np.array([0.0, side * 0.14, ground]), 0.0) for side in (1.0, -1.0)]
        self.com = np.array([0.02, 0.01, ground + 0.68])
        self.com_velocity = np.zeros(3)
        self.trace: list[tuple[float, ControlState, BodyReference]] = []
        self.answers: list[Answer] = []
        self.noise = 0.0
        self.foot_force = np.full(2, 180.0)
        self._rng = np.random.default_rng(4)
        self._dynamics = model.update(RobotState.from_plant(nominal_state()))
        self._dynamics = self._dynamics._replace(base_rotation=np.eye(3))

    def tick(self) -> BodyReference:
        self.time += 0.01
        reference = self.locomotion.update(self._measured(), self.foot_force, self.time)
        self.com = reference.com
        for side, swing in enumerate(reference.swing):
            if swing is not None:
                self.feet[side] = (swing.position, yaw_from_matrix(swing.rotation))
        self.trace.append((self.time, self.locomotion.state, reference))
        self.answers += self.locomotion.answers()
        return reference

    def _measured(self) -> Dynamics:
        feet = [
            foot._replace(
                position=position + self.noise * self._rng.normal(size=3),
                rotation=matrix_from_yaw(yaw + self.noise * self._rng.normal()),
            )
            for foot, (position, yaw) in zip(self._dynamics.feet, self.feet, strict=True)
        ]
        velocity = np.concatenate((self.com_velocity, np.zeros(27)))
        return self._dynamics._replace(
            feet=(feet[0], feet[1]), com_position=self.com, velocity=velocity
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100.0)):
            self.tick()

    def walk(self, gait: Gait) -> None:
        """One gait, then half a second of standing so that the feet are known well."""
        count = self.locomotion.completed
        self.locomotion.request(7, gait)
        self.tick()
        assert self.answers[-1].outcome is GaitOutcome.ACCEPTED, self.answers[-1].reason
        deadline = self.time + LONGEST
        while self.locomotion.completed == count:
            assert self.time < deadline, f"{gait.name} is never completed"
            self.tick()
        self.run(0.5)

    def slip(self, offset: Array, turn: float = 0.0) -> None:
        """Both feet move on the ground without the controller's doing; turn about the middle."""
        middle = self.stance()[0]
        rotation = matrix_from_yaw(turn)
        for side, (position, yaw) in enumerate(self.feet):
            arm = position - np.array([*middle, position[2]])
            moved = position - arm + rotation @ arm + np.array([*offset, 0.0])
            self.feet[side] = (moved, yaw + turn)
        # The estimate of a standing foot forgets with a time constant of 0.3 s.
        self.run(3.0)

    def stance(self) -> tuple[Array, float]:
        """Middle (2,) and mean yaw of the feet."""
        (left, left_yaw), (right, right_yaw) = self.feet
        return 0.5 * (left + right)[:2], 0.5 * (left_yaw + right_yaw)
