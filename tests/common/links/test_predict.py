"""Predicted delays, and the warning about a specification that does not keep its mean."""

import pytest

from common.errors import ConfigError
from common.links.predict import predict
from common.links.spec import PRESETS, LinkSpec


def test_constant_delay_is_what_it_says() -> None:
    prediction = predict(LinkSpec.parse("250ms loss=3%"), 20.0)
    assert prediction.predicted == prediction.requested
    assert (prediction.predicted.mean, prediction.predicted.sd) == (0.25, 0.0)
    assert prediction.warning == ""


def test_wide_normal_at_20_hz_is_far_too_long_and_says_why() -> None:
    prediction = predict(LinkSpec.parse("normal(122ms, 190ms)"), 20.0)
    assert prediction.requested.mean == 0.122
    # E[max(0, X)] of normal(122, 190) is 151.9 ms.
    assert prediction.clamping == pytest.approx(0.0299, abs=1e-4)
    assert prediction.clamped == pytest.approx(0.2604, abs=1e-3)
    assert 0.25 < prediction.predicted.mean < 0.29
    assert 0.6 < prediction.held_back < 0.72
    # Of the distribution as written, 564 ms.
    assert prediction.predicted.p99 > 0.6
    for part in ("not 122 ms", "26 % of the draws", "66 % of the messages", "order=free", "corr="):
        assert part in prediction.warning


@pytest.mark.parametrize("spec", ["normal(250ms, 20ms)", "lognormal(250ms, 20ms)"])
def test_the_remedies_that_a_warning_names_keep_the_mean(spec: str) -> None:
    prediction = predict(LinkSpec.parse(spec), 500.0)
    assert prediction.shift == pytest.approx(0.1, abs=0.02)
    assert prediction.warning
    for remedy in ("order=free", "corr=5s"):
        assert predict(LinkSpec.parse(f"{spec} {remedy}"), 500.0).shift == pytest.approx(
            0, abs=0.05
        )


def test_trace_is_counted_in_whole_rounds() -> None:
    spec = LinkSpec.model_validate({"distribution": "trace", "trace": [0.01, 0.03, 0.02]})
    prediction = predict(spec, 20.0)
    assert prediction.predicted.mean == pytest.approx(0.02)
    assert prediction.predicted.p99 == pytest.approx(0.03)


def test_paper_preset_keeps_its_mean_at_the_rate_of_set_points() -> None:
    spec = LinkSpec.parse("paper loss=1%")
    assert (spec.mean, spec.sd, spec.loss) == (0.122, 0.19, 0.01)
    assert LinkSpec.parse(PRESETS["paper"]) == LinkSpec.parse("paper")
    assert predict(LinkSpec.parse("paper"), 20.0).faithful


def test_impossible_rate_is_refused() -> None:
    with pytest.raises(ConfigError, match="rate of -1 Hz"):
        predict(LinkSpec.parse("1ms"), -1.0)
