"""How the synthetic operator does each task: one small plan of guarded way-points a module."""

from collections.abc import Callable
from typing import Final

from common.errors import ConfigError
from services.teleop.synthetic.person import Act, Person
from services.teleop.synthetic.strategies.bench_hammer import hammer
from services.teleop.synthetic.strategies.bench_push import push_cart
from services.teleop.synthetic.strategies.door_push import push_through
from services.teleop.synthetic.strategies.door_unlock import unlock
from services.teleop.synthetic.strategies.hardware_cap import take_cap_off
from services.teleop.synthetic.strategies.hardware_tool import tool_into_box
from services.teleop.synthetic.strategies.walk import walk_to_cart, walk_to_door

Strategy = Callable[[Person], Act]

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
"""By task."""


def find_strategy(task: str) -> Strategy:
    """The plan for ``task``.

    Raises:
        ConfigError: the synthetic operator does not know this task.
    """
    if task not in STRATEGIES:
        raise ConfigError(
            f"the synthetic operator has no plan for {task!r}; expected one of "
            f"{', '.join(STRATEGIES)}"
        )
    return STRATEGIES[task]
