"""Damaged payloads crash no reader and all are counted; a small run of verification.fuzz."""

import logging
from typing import Any

import pytest

from common.topics import ALL_TOPICS, PLANT_STATE, TELEOP_GAIT, Topic
from common.wire import arrays
from verification.fuzz.damage import DAMAGES
from verification.fuzz.run import fuzz_topic

COUNT = 1500


@pytest.mark.parametrize("topic", ALL_TOPICS, ids=lambda topic: topic.name)
def test_everything_is_counted_and_nothing_crashes(topic: Topic[Any]) -> None:
    result = fuzz_topic(topic, COUNT, seed=1)
    assert result.crash == ""
    assert result.fed == COUNT == result.applied + result.refused + result.late
    # Most damage shows; a flipped bit in a number does not.
    assert result.refused > 0.75 * COUNT
    assert set(result.refused_by_damage) == set(DAMAGES)
    assert result.applied > 0


def test_same_seed_same_result() -> None:
    first, second = (fuzz_topic(TELEOP_GAIT, 300, seed=4) for _ in range(2))
    assert first.refused_by_damage == second.refused_by_damage
    assert first.refused_by_damage != fuzz_topic(TELEOP_GAIT, 300, seed=5).refused_by_damage


def test_a_decoder_that_lets_nan_through_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    class Blind:
        def __getattr__(self, name: str) -> Any:
            return getattr(arrays_np, name)

        @staticmethod
        def isfinite(array: Any) -> Any:
            return arrays_np.ones(array.shape, bool)

    arrays_np = arrays.np  # type: ignore[attr-defined]
    monkeypatch.setattr(arrays, "np", Blind())
    logging.disable(logging.WARNING)
    try:
        with pytest.raises(Exception, match="came through as"):
            fuzz_topic(PLANT_STATE, 5000, seed=1)
    finally:
        logging.disable(logging.NOTSET)
