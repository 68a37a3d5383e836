"""PD gains, of tasks and of motors."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot import joints
from common.schemas.arrays import Float64Array as Array


class StrictModel(BaseModel):
    """A table of the controller's configuration; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Gains(StrictModel):
    """PD gains: of a task [1/s², 1/s], of a motor [N·m/rad, N·m·s/rad]."""

    kp: float = Field(ge=0.0, description="stiffness")
    kd: float = Field(ge=0.0, description="damping")


class MotorGains(StrictModel):
    """Joint PD gains applied by the plant around the measured state [N·m/rad, N·m·s/rad]."""

    hip: Gains = Gains(kp=100.0, kd=5.0)
    knee: Gains = Gains(kp=100.0, kd=5.0)
    ankle: Gains = Gains(kp=30.0, kd=1.5)
    shoulder: Gains = Gains(kp=40.0, kd=2.0)
    elbow: Gains = Gains(kp=40.0, kd=2.0)
    wrist: Gains = Gains(kp=15.0, kd=0.6)
    neck: Gains = Gains(kp=20.0, kd=1.0)

    def per_joint(self) -> tuple[Array, Array]:
        """Return stiffness [N·m/rad] and damping [N·m·s/rad] (27,) of the joints.

        A knee's gains are those of its coordinate, so each of its two hinges gets half.
        """
        stiffness, damping = np.zeros(joints.NUM_JOINTS), np.zeros(joints.NUM_JOINTS)
        for index, joint in enumerate(joints.JOINTS):
            part = next(name for name in MotorGains.model_fields if name in joint.name)
            gains: Gains = getattr(self, part)
            share = 0.5 if part == "knee" else 1.0
            stiffness[index], damping[index] = share * gains.kp, share * gains.kd
        return stiffness, damping
