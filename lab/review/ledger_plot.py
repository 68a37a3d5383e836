"""Draws the distributions of a latency ledger."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.journal.ledger import STAGES, Durations, LedgerRow
from lab.review.frames import write_picture

_PAPER, _GRID, _TEXT, _TITLE = (250, 252, 252), (222, 225, 225), (95, 95, 95), (30, 30, 30)
_BOX, _WHISKER, _MEDIAN, _TOTAL = (76, 133, 178), (160, 190, 214), (40, 40, 40), (214, 96, 48)
_LEFT, _RIGHT, _TOP, _ROW, _GAP = 96, 24, 64, 20, 34
_WIDTH = 760
_COLUMNS = 2
_LOW, _HIGH = -5.0, 1.0
"""The axis goes from 10 µs to 10 s."""
_TICKS = ((-5, "10 us"), (-4, "0.1"), (-3, "1 ms"), (-2, "10"), (-1, "100"), (0, "1 s"), (1, "10"))


def write_plot(path: Path, rows: Sequence[LedgerRow], title: str) -> None:
    """Write a PNG: a panel for each input, in it for each stage the spread of all its messages.

    Line: from the 1st to the 99th percentile; box: the middle half; tick: the median.

    Raises:
        LabError: the file cannot be written.
    """
    shown = [row for row in rows if row.applied]
    panel = _GAP + _ROW * len(STAGES) + 24
    lines = -(-len(shown) // _COLUMNS)
    image = np.empty((_TOP + panel * lines, _WIDTH * _COLUMNS, 3), np.uint8)
    image[:] = _PAPER
    _write(image, title, (16, 28), 0.62, _TITLE)
    legend = "line: 1st to 99th percentile, box: middle half, tick: median; logarithmic axis"
    _write(image, legend, (16, 50), 0.42, _TEXT)
    for number, row in enumerate(shown):
        x, y = _WIDTH * (number % _COLUMNS), _TOP + panel * (number // _COLUMNS)
        _panel(image[y : y + panel, x : x + _WIDTH], row)
    write_picture(path, image)


def _panel(image: NDArray[np.uint8], row: LedgerRow) -> None:
    bottom = _GAP + _ROW * len(STAGES)
    _write(image, f"{row.topic} > {row.consumer}   n = {row.applied}", (16, 20), 0.48, _TITLE)
    for power, label in _TICKS:
        x = _pixel(float(power))
        cv2.line(image, (x, _GAP - 4), (x, bottom), _GRID, 1)
        _write(image, label, (x - 14, bottom + 15), 0.38, _TEXT)
    for number, name in enumerate(STAGES):
        y = _GAP + _ROW * number + _ROW // 2
        _write(image, name, (16, y + 4), 0.42, _TEXT)
        if len(row.samples[name]):
            _box(image, y, row.samples[name], _TOTAL if name == "total" else _BOX)


def _box(image: NDArray[np.uint8], y: int, some: Durations, colour: tuple[int, int, int]) -> None:
    low, first, median, third, high = np.percentile(some, [1, 25, 50, 75, 99])
    if high <= 0.0:
        return  # a stage in which nothing was spent
    cv2.line(image, (_at(low), y), (_at(high), y), _WHISKER, 3)
    cv2.rectangle(image, (_at(first), y - 5), (_at(third) + 1, y + 5), colour, cv2.FILLED)
    cv2.line(image, (_at(median), y - 7), (_at(median), y + 7), _MEDIAN, 2)


def _at(seconds: float) -> int:
    return _pixel(float(np.log10(max(seconds, 10.0**_LOW))))


def _pixel(power: float) -> int:
    share = (min(max(power, _LOW), _HIGH) - _LOW) / (_HIGH - _LOW)
    return round(_LEFT + share * (_WIDTH - _LEFT - _RIGHT))


def _write(
    image: NDArray[np.uint8], text: str, at: tuple[int, int], size: float, colour: Any
) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
