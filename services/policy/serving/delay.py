"""How long a policy's set-points take to be used, measured from what the controller says; pure."""

from statistics import median

from common.runtime.service import Inputs
from common.topics import WBC_STATE

WINDOW = 1.0
"""The delay is the median of the set-points of this time [s]."""


def measured_delay(inputs: Inputs) -> float:
    """Return the time from the robot's state to the set-point made from it in use [s].

    A set-point carries the robot time of the state that its sender acted on, and the controller
    says which set-point it uses at which robot time. The difference at first use is the delay of
    both links together: all times are the robot's, so that no two clocks are compared. -1: the
    controller uses none of the present operator yet.
    """
    ages: dict[int, int] = {}
    for state in inputs.history(WBC_STATE, WINDOW):
        if state.setpoint_stamp:
            ages.setdefault(state.setpoint_stamp, state.header.stamp - state.setpoint_stamp)
    # Of the first one the first use may have been before.
    first_uses = list(ages.values())[1:]
    return 1e-9 * median(first_uses) if first_uses else -1.0
