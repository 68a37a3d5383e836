"""A set kept as runs is a set."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.logger.read.ranges import Ranges

NUMBERS = st.sets(st.integers(0, 60))


def runs_of(numbers: set[int]) -> list[tuple[int, int]]:
    starts = sorted(n for n in numbers if n - 1 not in numbers)
    ends = sorted(n for n in numbers if n + 1 not in numbers)
    return list(zip(starts, ends, strict=True))


@given(st.lists(st.integers(0, 60), max_size=60))
def test_adding_one_by_one(numbers: list[int]) -> None:
    ranges, model = Ranges(), set[int]()
    for number in numbers:
        assert ranges.add(number) is (number not in model)
        model.add(number)
        assert list(ranges) == runs_of(model)
        assert len(ranges) == len(model)
    assert all((number in ranges) is (number in model) for number in range(-1, 62))


@given(NUMBERS, st.integers(0, 60), st.integers(0, 20))
def test_adding_a_run(numbers: set[int], first: int, length: int) -> None:
    ranges = Ranges(runs_of(numbers))
    ranges.add_run(first, first + length)
    model = numbers | set(range(first, first + length + 1))
    assert list(ranges) == runs_of(model)
    assert len(ranges) == len(model)


@given(NUMBERS, NUMBERS)
def test_common(one: set[int], other: set[int]) -> None:
    assert Ranges(runs_of(one)).common(Ranges(runs_of(other))) == len(one & other)


def test_ends() -> None:
    assert (Ranges([(3, 5), (9, 9)]).first, Ranges([(3, 5), (9, 9)]).last) == (3, 9)
    for name in ("first", "last"):
        with pytest.raises(ValueError, match="empty set"):
            getattr(Ranges(), name)
