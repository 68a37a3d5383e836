"""Draws distributions of delays, one panel below the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.review.frames import write_picture

_PAPER, _GRID, _TEXT, _TITLE = (250, 252, 252), (222, 226, 226), (95, 95, 95), (30, 30, 30)
_BAR = (108, 158, 196)
_COLOURS = ((214, 96, 48), (60, 140, 60), (140, 60, 160))
"""Of the marks, in their order."""
_WIDTH, _HEIGHT = 720, 190
_LEFT, _RIGHT, _TOP, _BOTTOM = 20, 20, 44, 26
_BINS = 100


@dataclass(frozen=True)
class Panel:
    """One histogram.

    Attributes:
        title: a line above it.
        delays: [s].
        marks: named vertical lines, e.g. the mean that was asked for [s].
    """

    title: str
    delays: Sequence[float]
    marks: Sequence[tuple[str, float]] = ()


def write_histograms(path: Path, panels: Sequence[Panel], columns: int = 1) -> None:
    """Write a PNG of panels; each axis goes to its 99.5th percentile, or further if a mark does.

    Raises:
        LabError: the file cannot be written.
    """
    rows = -(-len(panels) // columns)
    image = np.empty((_HEIGHT * rows, _WIDTH * columns, 3), np.uint8)
    image[:] = _PAPER
    for number, panel in enumerate(panels):
        x, y = _WIDTH * (number % columns), _HEIGHT * (number // columns)
        _draw(image[y : y + _HEIGHT, x : x + _WIDTH], panel)
    write_picture(path, image)


def _draw(image: NDArray[np.uint8], panel: Panel) -> None:
    _write(image, panel.title, (_LEFT, 18), 0.46, _TITLE)
    base = _HEIGHT - _BOTTOM
    marks = [value for _, value in panel.marks]
    delays = np.asarray(panel.delays, float)
    longest = max([*marks, float(np.percentile(delays, 99.5)) if len(delays) else 0.0, 1e-3])
    longest *= 1.05

    def pixel(seconds: float) -> int:
        return _LEFT + round((_WIDTH - _LEFT - _RIGHT) * seconds / longest)

    step = _step(longest)
    for number in range(int(longest / step) + 1):
        x = pixel(number * step)
        cv2.line(image, (x, _TOP), (x, base), _GRID, 1)
        _write(image, f"{1e3 * number * step:g}", (x - 8, base + 16), 0.36, _TEXT)
    _write(image, "ms", (_WIDTH - _RIGHT - 16, base + 16), 0.36, _TEXT)
    counts, edges = np.histogram(delays, _BINS, (0.0, longest))
    scale = (base - _TOP) / max(1, counts.max())
    for count, left, right in zip(counts, edges[:-1], edges[1:], strict=True):
        if count:
            top = base - max(1, round(scale * count))
            cv2.rectangle(image, (pixel(left), top), (pixel(right) - 1, base), _BAR, cv2.FILLED)
    cv2.line(image, (_LEFT, base), (_WIDTH - _RIGHT, base), _TEXT, 1)
    at = _LEFT
    for (label, value), colour in zip(panel.marks, _COLOURS, strict=False):
        cv2.line(image, (pixel(value), _TOP), (pixel(value), base), colour, 2)
        text = f"{label} {1e3 * value:.1f} ms"
        _write(image, text, (at, 36), 0.4, colour)
        at += 9 + cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)[0][0]


def _step(longest: float) -> float:
    """A round distance between the lines of the axis [s]."""
    rough = longest / 8.0
    power = 10.0 ** np.floor(np.log10(rough))
    return float(next(power * unit for unit in (1.0, 2.0, 5.0, 10.0) if power * unit >= rough))


def _write(image: NDArray[np.uint8], text: str, at: tuple[int, int], size: float, c: Any) -> None:
    plain = text.encode("ascii", "replace").decode()
    cv2.putText(image, plain, at, cv2.FONT_HERSHEY_SIMPLEX, size, c, 1, cv2.LINE_AA)
