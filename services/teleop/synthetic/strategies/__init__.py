"""Strategies of the synthetic operator: a plan of way-points and conditions for each task."""

from collections.abc import Callable
from typing import Final

from common.errors import ConfigError
from services.teleop.synthetic.operator_model import Act, OperatorModel
from services.teleop.synthetic.strategies.bench_hammer import hammer
from services.teleop.synthetic.strategies.bench_push import push_cart
from services.teleop.synthetic.strategies.door_push import push_through
from services.teleop.synthetic.strategies.door_unlock import unlock
from services.teleop.synthetic.strategies.hardware_cap import take_cap_off
from services.teleop.synthetic.strategies.hardware_tool import tool_into_box
from services.teleop.synthetic.strategies.walk import walk_to_cart, walk_to_door

Strategy = Callable[[OperatorModel], Act]

STRATEGIES: Final[dict[str, Strategy]] = {
    "door/walk": walk_to_door,
    "door/unlock": unlock,
    "door/push": push_through,
    "bench/walk": walk_to_cart,
    "bench/hammer": hammer,
    "bench/push": push_cart,
    "hardware/tool": tool_into_box,
    "hardware/cap": take_cap_off,
}
"""Strategies by task."""


def find_strategy(task: str) -> Strategy:
    """Return the strategy for ``task``.

    Raises:
        ConfigError: there is no strategy for this task.
    """
    if task not in STRATEGIES:
        raise ConfigError(
            f"the synthetic operator has no strategy for {task!r}; expected one of "
            f"{', '.join(STRATEGIES)}"
        )
    return STRATEGIES[task]
