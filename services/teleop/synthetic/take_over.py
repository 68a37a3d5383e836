"""When the synthetic operator takes the robot over from a policy that does not get on."""

from collections.abc import Mapping

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot.pose import Pose
from common.robot.rotations import rotation_between
from services.teleop.synthetic.observation import Observation

MOVED = 0.02
"""A hand that has gone further than this gets on [m]."""
TURNED = 0.2
"""A hand that has turned by more than this gets on [rad]."""


class TakeOver(BaseModel):
    """When to take the robot over."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    stalled: float = Field(
        default=3.0,
        gt=0.0,
        description="after so long a time in which the robot balances and neither hand goes 2 cm "
        "or turns 0.2 rad [s]",
    )
    latest: float | None = Field(
        default=None,
        ge=0.0,
        description="in any case when the other operator has had the robot for so long and it "
        "balances [s]; null: never",
    )


class StallWatch:
    """Watches the robot in another operator's hands; pure."""

    def __init__(self, config: TakeOver) -> None:
        self._config = config
        self._hands: Mapping[str, Pose] = {}
        self._still = self._time = 0.0

    def update(self, seen: Observation, dt: float) -> bool:
        """Return whether it is time to take over, ``dt`` [s] after the last observation."""
        self._time += dt
        self._still += dt
        if not seen.balancing or not self._hands or self._moved(seen):
            self._hands, self._still = seen.hands, 0.0
        latest = self._config.latest
        late = latest is not None and self._time >= latest
        return seen.balancing and (self._still >= self._config.stalled or late)

    def _moved(self, seen: Observation) -> bool:
        return any(
            float(np.linalg.norm(hand.position - before.position)) > MOVED
            or float(np.linalg.norm(rotation_between(before.quaternion, hand.quaternion))) > TURNED
            for hand, before in zip(seen.hands.values(), self._hands.values(), strict=True)
        )
