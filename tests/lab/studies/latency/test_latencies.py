import pytest

from common.journal.journal import Journal
from common.journal.tables import UNKNOWN, InputOutcome, InputTimes
from common.schemas import Header
from lab.studies.latency.latencies import Latencies, mean_p99
from lab.studies.latency.meter import link_latency
from tests.lab.studies.latency.support import CONDITIONS

MS = 1_000_000
AT = ("wbc", "teleop/setpoint")


def step(
    journal: Journal,
    now: int,
    *sent: int,
    outcome: InputOutcome = InputOutcome.APPLIED,
    offset: int = 0,
) -> None:
    """A step at ``now`` [ms] takes in what was sent at these times [ms], 100 ms on the link."""
    journal.begin_step(now * MS)
    for time in sent:
        header = Header(sent=time * MS, source="teleop", boot=1)
        times = InputTimes(time * MS, 100 * MS, offset, 0)
        journal.record(AT[1], outcome, header, b"", "", times)
    journal.end_step(now * MS)


def heard(journal: Journal) -> Latencies:
    latencies = Latencies()
    message = journal.fetch()
    assert message is not None
    latencies.add(message)
    return latencies


def test_latency_is_from_sending_to_the_step_that_acted() -> None:
    journal = Journal("wbc")
    step(journal, 350, 100)
    step(journal, 360)
    step(journal, 400, 145)
    assert heard(journal).of(*AT) == pytest.approx([0.25, 0.255])


def test_a_step_acts_on_the_newest() -> None:
    journal = Journal("wbc")
    step(journal, 400, 200, 250, 300)
    assert heard(journal).of(*AT) == pytest.approx([0.1])


def test_what_was_lost_or_overtaken_has_no_latency() -> None:
    journal = Journal("wbc")
    step(journal, 400, 200, outcome=InputOutcome.LOST)
    step(journal, 410, 200, outcome=InputOutcome.LATE)
    latencies = heard(journal)
    assert latencies.of(*AT) == []
    assert latencies.lost(*AT) == 1
    link = link_latency(latencies, CONDITIONS[2], AT)
    assert (link.asked_mean, link.mean, link.used, link.lost) == (0.25, None, 0, 1)


def test_clocks_of_other_hosts() -> None:
    journal = Journal("wbc")
    step(journal, 5400, 200, offset=5000 * MS)
    step(journal, 5500, 300, offset=UNKNOWN)
    assert heard(journal).of(*AT) == pytest.approx([0.2])


def test_mean_and_percentile() -> None:
    assert mean_p99([]) is None
    assert mean_p99([float(value) for value in range(101)]) == pytest.approx((50.0, 99.0))
