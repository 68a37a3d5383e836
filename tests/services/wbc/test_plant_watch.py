"""When the controller has to take the robot over afresh, and why it is not obeyed."""

import numpy as np
import pytest

from common.schemas import GuardMode, PlantState
from services.wbc.plant_watch import LONGEST_GAP_NS, LONGEST_HOLD_NS, PlantWatch

from .support import MS, nominal_state

OWN, OTHER = 7, 8
TICK = 10 * MS


class Plant:
    """States every 10 ms to a controller that has run for a second."""

    def __init__(self) -> None:
        self.watch = PlantWatch("relaxed")
        self.now = 0
        self.say(100)

    def say(self, ticks: int = 1, **fields: object) -> list[str]:
        """What the controller takes it over for, state by state."""
        reasons = []
        for _ in range(ticks):
            self.now += TICK
            state: PlantState = nominal_state(self.now).model_copy(update=fields)
            reasons.append(self.watch.update(state, OWN))
        return reasons


def test_an_obedient_robot_needs_nothing() -> None:
    plant = Plant()
    assert plant.say(50, controller_boot=OWN) == [""] * 50
    assert plant.watch.obstacle == ""


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"guard": GuardMode.ESTOP}, "emergency stop"),
        ({"guard": GuardMode.ESTOP, "fallen": True}, "emergency stop"),
        ({"fallen": True}, "fallen"),
        ({"guard": GuardMode.DAMP}, "limp"),
        ({"controller_boot": OTHER}, "another controller"),
    ],
)
def test_a_robot_that_does_not_obey_is_taken_over_again_and_again(
    fields: dict[str, object], words: str
) -> None:
    plant = Plant()
    reasons = plant.say(100, **fields)
    assert words in reasons[0]
    assert words in plant.watch.obstacle
    assert plant.watch.bystander == ("controller_boot" in fields)
    # Each time from the measured posture, so that no plan runs ahead for longer than a gap may.
    taken = [n for n, reason in enumerate(reasons) if reason]
    assert set(np.diff(taken).tolist()) == {13}
    assert plant.say() == [""]
    assert plant.watch.obstacle == ""


@pytest.mark.parametrize("guard", [GuardMode.HOLD, GuardMode.SILENT])
def test_a_short_hold_goes_by(guard: GuardMode) -> None:
    plant = Plant()
    allowed = LONGEST_HOLD_NS // TICK
    assert plant.say(allowed, guard=guard) == [""] * allowed
    assert plant.watch.obstacle == ""
    (reason,) = plant.say(guard=guard)
    assert "holds the robot" in reason


def test_the_plant_of_a_silent_controller_is_free_to_this_one() -> None:
    plant = Plant()
    plant.say(guard=GuardMode.HOLD, controller_boot=OTHER)
    assert not plant.watch.bystander


def test_after_a_silence_of_its_own_it_takes_over_once() -> None:
    """The guard holds until the first command after it arrives, some ticks later."""
    plant = Plant()
    plant.now += LONGEST_GAP_NS
    reasons = plant.say(6, guard=GuardMode.HOLD) + plant.say(50)
    assert "silent for 0.13 s" in reasons[0]
    assert not any(reasons[1:])


def test_a_reset_or_a_time_that_goes_back_is_a_reset() -> None:
    plant = Plant()
    assert plant.say(reset_count=1) == ["the plant was reset"]
    plant.now = 0
    assert plant.say(2, reset_count=1) == ["the plant was reset", ""]


def test_other_torque_limits_come_before_every_other_obstacle() -> None:
    plant = Plant()
    plant.say(10, torque_mode="relaxed", controller_boot=OWN)
    assert plant.watch.misfit == ""
    (reason,) = plant.say(1, torque_mode="rated", guard=GuardMode.ESTOP)
    assert reason == plant.watch.obstacle == plant.watch.misfit
    assert "rated, the controller's relaxed" in reason
    plant.say(1, controller_boot=OWN)
    assert plant.watch.misfit == "", "a plant that does not tell is trusted"


def test_a_stop_that_began_and_ended_between_two_states_is_noticed_once() -> None:
    plant = Plant()
    assert "emergency stop" in plant.say(stops=1)[0]
    assert plant.watch.stopped
    assert plant.say(2, stops=1) == ["", ""]
    assert not plant.watch.stopped
    # A plant that forgot its stops was restarted without a record: no new stop.
    plant.say(stops=0)
    assert not plant.watch.stopped
    # Who begins after a stop cannot tell when it was.
    later = PlantWatch("relaxed")
    later.update(nominal_state(TICK).model_copy(update={"stops": 1}), OWN)
    assert not later.stopped
