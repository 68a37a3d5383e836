import pytest

from common.errors import ConfigError
from lab.studies.latency.conditions import (
    COMMAND_INPUT,
    FEEDBACK_INPUT,
    Condition,
    chosen_conditions,
    standard,
)
from tests.lab.studies.latency.support import plan_of


def test_the_standard_conditions_are_the_four_of_the_paper() -> None:
    raw, interpolation, short, long = standard("command")
    assert (raw.raw_hands, raw.links) == (True, {})
    assert (interpolation.raw_hands, interpolation.links) == (False, {})
    assert short.asked(*COMMAND_INPUT) == (0.25, 0.25)
    assert short.asked(*FEEDBACK_INPUT) == (0.0, 0.0)
    assert long.asked(*COMMAND_INPUT) == (0.5, 0.5)
    assert not short.raw_hands


def test_a_direction_is_delayed_alone_or_both() -> None:
    back = standard("feedback")[2]
    assert (back.asked(*COMMAND_INPUT)[0], back.asked(*FEEDBACK_INPUT)[0]) == (0.0, 0.25)
    both = standard("both")[2]
    assert (both.asked(*COMMAND_INPUT)[0], both.asked(*FEEDBACK_INPUT)[0]) == (0.25, 0.25)
    assert both.delay == 0.5
    with pytest.raises(ConfigError, match="sideways"):
        standard("sideways")


def test_ones_own_condition() -> None:
    mine = Condition.parse("mine=command=lognormal(122ms, 190ms) corr=10s,feedback=50ms,raw")
    assert mine.links == {"command": "lognormal(122ms, 190ms) corr=10s", "feedback": "50ms"}
    assert mine.raw_hands
    assert mine.asked(*COMMAND_INPUT)[0] == pytest.approx(0.122)
    assert Condition.parse("plain=none").links == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mine", "standard condition"),
        ("mine=fast", "'fast' is unknown"),
        ("mine=command=soon", "soon"),
        ("mine=weather=10ms", "weather"),
        ("Mine=none", "name"),
    ],
)
def test_a_wrong_condition_is_explained(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        chosen_conditions([text], "command")


def test_a_name_stands_for_one_condition() -> None:
    assert [c.name for c in chosen_conditions(["raw", "far=both=1s"], "command")] == ["raw", "far"]
    with pytest.raises(ConfigError, match="different names"):
        chosen_conditions(["raw", "raw=none"], "command")


def test_what_others_are_compared_with() -> None:
    raw, interpolation, short, _ = standard("command")
    assert plan_of(raw, short, interpolation).baseline == interpolation
    plain = Condition(name="plain")
    assert plan_of(raw, short, plain).baseline == plain
    assert plan_of(short, raw).baseline == short


def test_a_plan_has_the_same_seeds_in_each_condition() -> None:
    plan = plan_of(*standard("command")[:2], tasks=("door/unlock",), first_seed=4)
    assert [(c.seed, c.condition) for c in plan.keys(2)] == [
        (4, "raw"), (4, "interpolation"), (5, "raw"), (5, "interpolation"),
    ]  # fmt: skip
    specs = [plan.spec(key) for key in plan.keys(1)]
    assert [(spec.seed, spec.raw_hands, spec.links) for spec in specs] == [
        (4, True, {}),
        (4, False, {}),
    ]
