"""Draws how the terms of the loss fell, on episodes learned from and on held-out ones."""

import json
from pathlib import Path
from typing import Any

from lab.review.figure import DPI, GRID_COLOUR, new_figure

_COLOURS = {"train": "#8a8f98", "held_out": "#2b6cb0"}
_LABELS = {"train": "learned from", "held_out": "held out"}


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Return the lines of ``metrics.jsonl``; of a step that was taken twice, the later."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return list({line["step"]: line for line in lines}.values())


def draw_curves(lines: list[dict[str, Any]], path: Path) -> None:
    """Write a PNG file with a panel for the loss and for each of its terms.

    Raises:
        ConfigError: Matplotlib is not installed.
    """
    terms = [name for name in lines[-1]["held_out"] if name != "loss"]
    panels = ["loss", *terms]
    figure = new_figure(round(3.2 * DPI * len(panels)), round(3.0 * DPI))
    for axes, term in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for part, colour in _COLOURS.items():
            shown = [(line["step"], line[part][term]) for line in lines if term in line[part]]
            axes.plot(*zip(*shown, strict=True), color=colour, label=_LABELS[part])
        axes.set_title(f"{term} [nats]" if term != "loss" else "loss, weighted", fontsize=9)
        axes.set_xlabel("step")
        axes.grid(color=GRID_COLOUR)
    figure.axes[0].legend(fontsize=8)
    figure.savefig(path)
