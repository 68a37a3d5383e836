"""A set of sequence numbers, kept as runs: hours of them without a gap are one pair of numbers."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator


class Ranges:
    """A set of integers as sorted, disjoint, non-adjacent runs ``[first, last]``.

    Adding at the end, which is what a stream of messages does, takes constant time.
    """

    def __init__(self, runs: Iterable[tuple[int, int]] = ()) -> None:
        """Start with the given runs, both ends included."""
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        self._count = 0
        for first, last in runs:
            self.add_run(first, last)

    def __len__(self) -> int:
        return self._count

    def __bool__(self) -> bool:
        return self._count > 0

    def __contains__(self, value: int) -> bool:
        place = bisect_right(self._firsts, value) - 1
        return place >= 0 and value <= self._lasts[place]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """The runs, ascending."""
        return zip(self._firsts, self._lasts, strict=True)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Ranges) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    @property
    def first(self) -> int:
        """The smallest member; ValueError if there is none."""
        if not self._firsts:
            raise ValueError("an empty set has no first member")
        return self._firsts[0]

    @property
    def last(self) -> int:
        """The largest member; ValueError if there is none."""
        if not self._lasts:
            raise ValueError("an empty set has no last member")
        return self._lasts[-1]

    def without_ends(self) -> tuple[int, ...]:
        """The smallest and the largest member, leaving out a member that stands alone at an end."""
        firsts, lasts = self._firsts, self._lasts
        if not firsts:
            return ()
        low = 0 if firsts[0] < lasts[0] else 1
        high = len(firsts) - (1 if firsts[-1] < lasts[-1] else 2)
        return (firsts[low], lasts[high]) if low <= high else ()

    def ends_outside(self, first: int, last: int) -> int:
        """How many of the smallest and the largest member are not in ``first`` to ``last``."""
        ends = {self._firsts[0], self._lasts[-1]} if self._firsts else set()
        return sum(not first <= end <= last for end in ends)

    def is_next(self, value: int) -> bool:
        """Whether ``value`` is one more than the last member."""
        return bool(self._lasts) and value == self._lasts[-1] + 1

    def add(self, value: int) -> bool:
        """Add ``value``; False if it was there already."""
        lasts = self._lasts
        if lasts and value == lasts[-1] + 1:
            lasts[-1] = value
            self._count += 1
            return True
        if value in self:
            return False
        self.add_run(value, value)
        return True

    def add_run(self, first: int, last: int) -> None:
        """Add all of ``first`` to ``last``, whatever of them is there already."""
        # Every run that overlaps or touches the new one is joined with it.
        low = bisect_right(self._firsts, first) - 1
        if low < 0 or self._lasts[low] + 1 < first:
            low += 1
        high = bisect_right(self._firsts, last + 1)
        if low < high:
            first = min(first, self._firsts[low])
            last = max(last, self._lasts[high - 1])
        gone = sum(
            b - a + 1 for a, b in zip(self._firsts[low:high], self._lasts[low:high], strict=True)
        )
        self._firsts[low:high] = [first]
        self._lasts[low:high] = [last]
        self._count += last - first + 1 - gone

    def common(self, other: "Ranges") -> int:
        """How many integers are in both."""
        total = place = 0
        for first, last in self:
            while place < len(other._firsts) and other._lasts[place] < first:
                place += 1
            at = place
            while at < len(other._firsts) and other._firsts[at] <= last:
                total += min(last, other._lasts[at]) - max(first, other._firsts[at]) + 1
                at += 1
        return total
