"""The experiment with bad readers: its arithmetic, and a short run of it."""

import pytest

from verification.faults.slow_subscriber import SlowSubscriber, summarise
from verification.faults.support.probes import Sent


def test_summary_compares_with_the_healthy_reader() -> None:
    windows = {"peer healthy": [(0, 100)], "peer paused": [(100, 200)]}
    sent = [
        # A put of a state takes 1 µs, then 3; commands and pictures stay as they are.
        *(Sent("plant/state", t, t, t + 1000) for t in range(100)),
        *(Sent("plant/state", t, t, t + 3000) for t in range(100, 200)),
        *(
            Sent(topic, 0, t, t + 500)
            for t in (50, 150)
            for topic in ("wbc/command", "camera/left", "camera/right", "heartbeat")
        ),
    ]
    rows = summarise(windows, sent, [*range(100), *range(100, 190)])
    by_kind = {(row["reader"], row["message"]): row for row in rows}
    assert len(by_kind) == 6
    healthy, paused = by_kind["peer healthy", "state"], by_kind["peer paused", "state"]
    assert healthy["p99 [µs]"] == pytest.approx(1.0)
    assert healthy["missed by healthy reader"] == 0
    assert paused["p99 ratio"] == pytest.approx(3.0)
    assert by_kind["peer paused", "command"]["p99 ratio"] == pytest.approx(1.0)
    assert by_kind["peer paused", "picture"]["sent"] == 2
    assert paused["missed by healthy reader"] == 10


def test_a_bad_reader_takes_nothing_from_a_healthy_one() -> None:
    rows = SlowSubscriber(rounds=1, seconds=1.0).measure(lambda _text: None)
    assert len(rows) == 8 * 3
    for row in rows:
        # Blocking would hold a put for seconds.
        assert float(row["max [µs]"]) < 2_000_000, row
        if row["message"] == "state":
            assert float(row["sent"]) > 100
            assert float(row["missed by healthy reader"]) < 0.2 * float(row["sent"]), row
