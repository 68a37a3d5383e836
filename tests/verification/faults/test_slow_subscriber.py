"""The study of bad readers: its arithmetic, and a short run of it."""

import pytest

from deploy.ports import reserve_base_port
from verification.faults.slow_subscriber import measure, summary


def test_summary_compares_with_the_healthy_reader() -> None:
    result = {
        "windows": {"peer healthy": [(0, 100)], "peer paused": [(100, 200)]},
        # topic, start, duration: states take 1 µs, then 3; commands and pictures stay as they are
        "rows": [
            *((0, t, 1000) for t in range(100)),
            *((0, t, 3000) for t in range(100, 200)),
            *((topic, t, 500) for t in (50, 150) for topic in (1, 2, 3)),
        ],
        "arrivals": [*range(100), *range(100, 190)],
    }
    healthy, paused = summary(result)
    assert healthy["condition"] == "peer healthy"
    assert healthy["state"]["p99"] == pytest.approx(1.0)
    assert healthy["states received"] == 100
    assert paused["state"]["ratio"] == pytest.approx(3.0)
    assert paused["command"]["ratio"] == pytest.approx(1.0)
    assert paused["states sent"] - paused["states received"] == 10


def test_a_bad_reader_takes_nothing_from_a_healthy_one() -> None:
    with reserve_base_port("127.0.0.1", None) as port:
        table = summary(measure(port, rounds=1, seconds=1.0))
    assert len(table) == 8
    for row in table:
        assert row["states sent"] > 100
        assert row["states received"] > 0.8 * row["states sent"], row
        # Blocking would hold a put for seconds.
        assert row["state"]["max"] < 2_000_000, row
