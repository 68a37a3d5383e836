"""Times of senders on other machines, whose clocks are not the recorder's."""

import pytest

from common.schemas import Header, PeerHealth, ServiceHealth
from services.logger.read.sender_clocks import SenderClocks
from tests.services.logger.export_support import health

MS, S = 1_000_000, 1_000_000_000


def header(source: str, sent: int, captured: int = 0) -> Header:
    return Header(source=source, boot=1, seq=0, sent=sent, captured=captured)


@pytest.mark.parametrize("ahead", [1, 30 * S, 59 * S, -30 * S, -3 * S, 10**15])
def test_a_clock_of_a_host_booted_at_another_time_is_not_believed(ahead: int) -> None:
    clocks = SenderClocks()
    for arrival in range(100 * S, 101 * S, 100 * MS):
        times = clocks.times(header("other", max(1, arrival + ahead)), arrival)
        assert (times.sent, times.logged) == (arrival, arrival)


def test_nothing_is_ever_sent_after_it_arrived() -> None:
    clocks = SenderClocks()
    assert clocks.times(header("sim", 100 * S - MS), 100 * S).sent == 100 * S - MS
    # One late message does not make its sender foreign, one from the future does.
    assert clocks.times(header("sim", 101 * S), 111 * S).sent == 101 * S
    assert clocks.times(header("sim", 120 * S), 112 * S).sent == 112 * S
    assert clocks.times(header("sim", 112 * S), 113 * S).sent == 113 * S


def test_the_offset_that_a_service_beside_the_recorder_measured_is_used() -> None:
    clocks = SenderClocks()
    report: ServiceHealth = health("wbc").model_copy(
        update={
            "header": header("wbc", 100 * S),
            "peers": [
                PeerHealth(
                    source="teleop", alive=True, silent=0.0, clock_offset=-30.0, clock_error=0.001
                )
            ],
        }
    )
    clocks.times(report.header, 100 * S + MS)
    clocks.learn(report)
    # Its clock is 30 s ahead; the message took 200 ms, and was captured 50 ms before.
    times = clocks.times(header("teleop", 130 * S, 130 * S - 50 * MS), 100 * S + 200 * MS)
    assert times.sent == 100 * S
    assert times.stamp == 100 * S - 50 * MS
    # An offset that is off a little moves nothing behind its arrival.
    assert clocks.times(header("teleop", 131 * S), 101 * S - MS).sent == 101 * S - MS
