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
    account = fuzz_topic(topic, COUNT, seed=1)
    assert account.crash == ""
    assert account.fed == COUNT == account.applied + account.refused + account.late
    # Most damage shows; a flipped bit in a number does not.
    assert account.refused > 0.75 * COUNT
    assert set(account.by_damage) == set(DAMAGES)
    assert account.applied > 0


def test_same_seed_same_account() -> None:
    first, second = (fuzz_topic(TELEOP_GAIT, 300, seed=4) for _ in range(2))
    assert first.by_damage == second.by_damage
    assert first.by_damage != fuzz_topic(TELEOP_GAIT, 300, seed=5).by_damage


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
