"""A small version of the study of links: consumers see the requested delays."""

import json
from pathlib import Path

import numpy as np
import pytest

from common.links.predict import predict
from common.links.spec import LinkSpec
from tests.common.transport.support import free_base_port
from verification.links import simulated
from verification.links.__main__ import main
from verification.links.live import bench
from verification.links.parts import RATE

SECONDS = 20.0


@pytest.mark.parametrize(("link", "delay"), [("0", 0.0), ("250ms", 0.25), ("500ms", 0.5)])
def test_constant_links_are_exact_in_simulated_time(link: str, delay: float) -> None:
    for found in simulated.measure(link, SECONDS):
        assert len(found.late) == RATE * SECONDS
        assert set(found.achieved) == {delay}
        assert max(found.late) == 0.0


def test_off_grid_delay_is_seen_by_the_next_step() -> None:
    for found in simulated.measure("123ms", SECONDS):
        assert {round(1e3 * delay, 6) for delay in found.achieved} == {130.0}


def test_jitter_is_drawn_held_back_and_sampled_as_predicted() -> None:
    link = "normal(122ms, 190ms) seed=7"
    prediction = predict(LinkSpec.parse(link), RATE)
    for found in simulated.measure(link, 100.0):
        assert 0.0 <= found.late.min() <= found.late.max() < 0.01
        injected = float(found.injected.mean())
        # 2000 messages; draws that wait for one another are about 500 independent ones.
        assert injected == pytest.approx(prediction.predicted.mean, abs=0.03)
        assert found.achieved.mean() == pytest.approx(injected + 0.005, abs=0.001)


def test_same_seed_same_delays() -> None:
    first, again, other = (
        simulated.measure("paper", SECONDS, seed)[0].achieved for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_live_links_hold_messages_for_as_long_as_asked() -> None:
    with bench(free_base_port(20), priority=0) as running:
        measured = running.measure("150ms", 3.0, settle_s=2.0)
    assert len(measured) == 3
    for found in measured:
        assert len(found.late) > 20
        assert found.achieved.min() >= 0.150
        assert np.median(found.achieved) < 0.200


def test_study_writes_its_numbers_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "links"
    words = ["--no-live", "--simulated", "5", "--links", "20ms", "--out", str(out)]
    assert main(words) == 0
    assert "20.0" in capsys.readouterr().out
    results = json.loads(out.with_suffix(".json").read_text())["results"]
    assert [(one["messages"], one["achieved"]["p99"]) for one in results] == [(100, 0.02)] * 2
    assert out.with_suffix(".png").stat().st_size > 5000
    assert main(["--links", "wide"]) == 2
    assert "'wide'" in capsys.readouterr().err
