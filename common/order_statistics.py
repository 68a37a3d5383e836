"""Exact order statistics of numbers that do not fit in memory, in a few passes over them. Pure."""

from collections.abc import Callable, Iterable, Sequence
from math import ceil, floor

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.int64] | npt.NDArray[np.float64]
Parts = Callable[[], Iterable[Numbers]]
"""Yields all numbers in pieces, each time it is called."""

_DIGITS = 2**16
_SIGN, _REST = np.uint64(2**63), np.int64(2**63 - 1)
"""Bit that tells negative numbers, and all others."""


def quantiles(parts: Parts, count: int, shares: Sequence[float]) -> list[float]:
    """Return the numbers that these ``shares`` (0 to 1) of all ``count`` numbers do not exceed.

    Between two numbers it interpolates, as ``numpy.quantile`` does.
    """
    places = [share * (count - 1) for share in shares]
    ranks = [rank for place in places for rank in (floor(place), ceil(place))]
    found = iter(order_statistics(parts, ranks))
    return [
        lower + (place - floor(place)) * (upper - lower)
        for place, lower, upper in zip(places, found, found, strict=True)
    ]


def order_statistics(parts: Parts, ranks: Sequence[int]) -> list[float | int]:
    """Return the numbers that would stand at ``ranks``, counted from 0, if all were sorted.

    This is a radix selection: four passes over the numbers, each of which finds sixteen bits more
    of the results.

    Args:
        parts: the numbers, all int64 or all float64 without NaN.
        ranks: less than the count of the numbers.
    """
    found = [(0, rank) for rank in ranks]
    kind: np.dtype[np.generic] = np.dtype(np.float64)
    for shift in (48, 32, 16, 0):
        prefixes = {prefix for prefix, _ in found}
        counts = {prefix: np.zeros(_DIGITS, np.int64) for prefix in prefixes}
        for part in parts():
            kind, keys = part.dtype, _ordered_keys(part)
            for prefix in prefixes:
                some = keys if shift == 48 else keys[keys >> np.uint64(shift + 16) == prefix]
                digits = (some >> np.uint64(shift)) & np.uint64(_DIGITS - 1)
                counts[prefix] += np.bincount(digits.astype(np.int64), minlength=_DIGITS)
        found = [_narrowed(counts[prefix], prefix, rank) for prefix, rank in found]
    keys = np.array([prefix for prefix, _ in found], np.uint64)
    return _from_keys(keys, kind).tolist()  # type: ignore[no-any-return]


def _narrowed(count: npt.NDArray[np.int64], prefix: int, rank: int) -> tuple[int, int]:
    """Append the digit of the number at ``rank`` among those with ``prefix``; its rank in there."""
    ends = np.cumsum(count)
    digit = int(np.searchsorted(ends, rank, side="right"))
    return prefix * _DIGITS + digit, rank - int(ends[digit] - count[digit])


def _ordered_keys(numbers: Numbers) -> npt.NDArray[np.uint64]:
    """Return unsigned integers that are ordered as the numbers are."""
    bits = numbers.view(np.int64)
    # The greater a negative floating-point number, the smaller are its bits.
    flipped = bits ^ ((bits >> 63) & _REST) if numbers.dtype == np.float64 else bits
    return flipped.view(np.uint64) ^ _SIGN


def _from_keys(keys: npt.NDArray[np.uint64], kind: "np.dtype[np.generic]") -> Numbers:
    bits = (keys ^ _SIGN).view(np.int64)
    return (bits ^ ((bits >> 63) & _REST)).view(np.float64) if kind == np.float64 else bits
