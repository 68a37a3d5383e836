"""What happens beside a loop does not end it."""

import pytest

from common.runtime.live.components import Component, ComponentSet

SECOND = 1_000_000_000


class Counting(Component):
    """Wants to be tended at once, always; fails as long as it is told to."""

    def __init__(self) -> None:
        self.due_ns = 0
        self.tended = 0
        self.failing = False

    def poll(self, now_ns: int) -> None:
        self.tended += 1
        if self.failing:
            raise ValueError("no such luck")


def test_an_aide_that_fails_rests_and_the_others_go_on(caplog: pytest.LogCaptureFixture) -> None:
    sick, well = Counting(), Counting()
    sick.failing = True
    well.due_ns = 3 * SECOND
    crew = ComponentSet((sick, well))
    assert crew.due_ns == 0
    for tenth in range(10):
        crew.poll(tenth * SECOND // 10)
    assert (sick.tended, well.tended) == (1, 10)
    # It does not keep the loop awake meanwhile.
    assert crew.due_ns == SECOND
    (record,) = caplog.records
    assert record.getMessage() == "Counting failed; the service goes on"
    assert record.exc_info
    sick.failing = False
    crew.poll(SECOND, only_due=True)
    crew.poll(2 * SECOND, only_due=True)
    assert (sick.tended, well.tended) == (3, 10)
    crew.poll(3 * SECOND, only_due=True)
    assert (sick.tended, well.tended) == (4, 11)
