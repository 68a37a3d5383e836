"""Patterns select what is recorded and what is subscribed to."""

import pytest

from common.errors import ConfigError
from common.topics import ALL_TOPICS
from services.logger.record.selection import Selection


def test_everything() -> None:
    assert Selection("r1").expressions() == ["r1/**"]
    assert Selection("r1").wants("r1/anything/at/all")


def test_only_some() -> None:
    selection = Selection("r1", topics=["plant/*", "health/**"])
    assert selection.expressions() == ["r1/plant/*", "r1/health/**"]
    assert selection.wants("r1/plant/state")
    assert selection.wants("r1/health/sim")
    assert not selection.wants("r1/wbc/state")
    assert not selection.wants("r2/plant/state")


def test_all_but_some_are_subscribed_to_one_by_one() -> None:
    selection = Selection("r1", exclude=["camera/**", "health/sim"])
    expressions = selection.expressions(["r1/camera/depth", "r1/arm/pose"])
    assert not any("camera" in text for text in expressions)
    assert {"r1/plant/state", "r1/health/*", "r1/arm/pose"} <= set(expressions)
    assert selection.wants("r1/health/wbc")
    assert not selection.wants("r1/health/sim")
    assert not selection.wants("r1/camera/left")


def test_both() -> None:
    selection = Selection("r1", topics=["plant/*"], exclude=["plant/truth"])
    names = {topic.name for topic in ALL_TOPICS if topic.name.startswith("plant/")}
    assert set(selection.expressions()) == {f"r1/{name}" for name in names - {"plant/truth"}}


@pytest.mark.parametrize("pattern", ["", "/x", "a//b", "a/**c", "#"])
def test_no_pattern(pattern: str) -> None:
    with pytest.raises(ConfigError, match="pattern of topics"):
        Selection("r1", topics=[pattern])
