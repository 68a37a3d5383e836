"""The emergency stop button against a plant that hears only some of what it sends."""

import numpy as np
import pytest

from common.estop import BURST, StopButton
from common.schemas import Estop, GuardMode, PlantStatus
from tests.common.transport.support import examples

TICK_NS = 50_000_000
ACTIVE = next(m for m in examples() if isinstance(m, PlantStatus)).model_copy(
    update={"guard": GuardMode.ACTIVE}
)
STOPPED = ACTIVE.model_copy(update={"guard": GuardMode.ESTOP})


def pressed(messages: list[Estop]) -> int:
    return sum(message.pressed for message in messages)


def test_a_button_beats_ten_times_a_second_until_it_is_pressed() -> None:
    button = StopButton()
    sent = [button.poll(tick * TICK_NS, ACTIVE, stamp=5) for tick in range(20)]
    assert [len(messages) for messages in sent] == [1, 0] * 10
    uneven = [button.poll(t * 1_000_000) for t in (1001, 1049, 1098, 1152, 1199)]
    assert [len(messages) for messages in uneven] == [1, 0, 1, 0, 1]
    assert sent[0][0] == Estop(header=sent[0][0].header, reason="", pressed=False)
    assert sent[0][0].header.stamp == 5


def test_a_press_is_repeated_until_the_plant_confirms_it_and_no_longer() -> None:
    button = StopButton()
    button.press("smoke", 0)
    for tick in range(100):
        messages = button.poll(tick * TICK_NS, ACTIVE if tick % 2 else None)
        assert pressed(messages) == BURST == len(messages)
        assert messages[0].reason == "smoke"
    assert button.pressed_ns == 0
    assert pressed(button.poll(100 * TICK_NS, STOPPED)) == 0
    assert button.pressed_ns is None


def test_a_status_from_before_the_press_confirms_nothing() -> None:
    button = StopButton()
    button.poll(0, STOPPED)
    button.press("again", TICK_NS)
    assert pressed(button.poll(TICK_NS, STOPPED)) == BURST
    button.press("and again", 2 * TICK_NS)
    assert pressed(button.poll(2 * TICK_NS, STOPPED)) == BURST
    assert button.pressed_ns == TICK_NS
    assert pressed(button.poll(3 * TICK_NS, STOPPED)) == 0


@pytest.mark.parametrize(("loss", "late"), [(0.5, 0.01), (0.9, 0.45)])
def test_the_first_burst_gets_through_a_lossy_link(loss: float, late: float) -> None:
    """Share of 2,000 presses of which no copy of the first burst arrives."""
    rng = np.random.default_rng(3)
    missed = 0
    for _ in range(2000):
        button = StopButton()
        button.press("", 0)
        missed += not (rng.uniform(size=len(button.poll(0))) > loss).any()
    assert missed / 2000 < late
