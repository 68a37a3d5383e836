"""A component that raises does not end the loop."""

import pytest

from common.runtime.live.components import Component, ComponentSet

SECOND = 1_000_000_000


class Counting(Component):
    """Is always due; raises while ``failing`` is set."""

    def __init__(self) -> None:
        self.due_ns = 0
        self.polls = 0
        self.failing = False

    def poll(self, now_ns: int) -> None:
        self.polls += 1
        if self.failing:
            raise ValueError("no such luck")


def test_a_component_that_raises_is_disabled_for_a_second_and_the_others_go_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    sick, well = Counting(), Counting()
    sick.failing = True
    well.due_ns = 3 * SECOND
    components = ComponentSet((sick, well))
    assert components.due_ns == 0
    for tenth in range(10):
        components.poll(tenth * SECOND // 10)
    assert (sick.polls, well.polls) == (1, 10)
    # It does not keep the loop awake meanwhile.
    assert components.due_ns == SECOND
    (record,) = caplog.records
    assert record.getMessage() == "Counting failed; the service goes on"
    assert record.exc_info
    sick.failing = False
    components.poll(SECOND, only_due=True)
    components.poll(2 * SECOND, only_due=True)
    assert (sick.polls, well.polls) == (3, 10)
    components.poll(3 * SECOND, only_due=True)
    assert (sick.polls, well.polls) == (4, 11)
