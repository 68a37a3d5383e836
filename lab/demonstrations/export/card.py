"""Writes the README of an exported data set: what it is, and what each number means."""

from collections.abc import Sequence

from common.episodes.columns import AXES, RATE
from lab.demonstrations.export.fields import ColumnRange
from lab.demonstrations.export.selection import ExportInput

_OPERATORS = {
    "synthetic": "a synthetic operator, which is a program that imitates a person",
    "person": "a person",
    "policy": "a learned policy",
}
_CARD = """---
task_categories:
- robotics
tags:
- LeRobot
- trill
configs:
- config_name: default
  data_files: data/*/*.parquet
---
# Demonstrations by the DRACO 3 humanoid in simulation

{episodes} episodes ({successes} successes), {frames} frames at {rate} Hz, in lerobot's format v3.0.
{operators} trill made them; `meta/trill.json` has the settings of each episode.

| task | goal | seeds |
|---|---|---|
{tasks}

## observation.state

| columns | |
|---|---|
{state}

## action

| columns | |
|---|---|
{action}

`meta/info.json` names each column. Numbers are as collected, in float32; nothing is scaled. The
body frame is {axes}; quaternions are (w, x, y, z). Locomotion and
controller state are numbers of kinds, not quantities.

A frame's action was given at that frame; its observation is the newest that the robot then had.
`meta/trill.json` has the cameras' matrices and poses. `meta/modality.json` divides state and action
for GR00T, which needs the data set in format v2 besides (its own script converts it).
`age.*` says how old that was [s]: joints (`state`), controller state, stereo pair (`picture`), and
what the operator acted on (`seen`), which a delayed link makes older. `next.success` is true in the
frame whose action the judge called a success, and after it; `next.done` in the last.
"""


def card(source: ExportInput) -> str:
    """Return the text, in Markdown with the head that dataset hubs read."""
    episodes = source.episodes
    seeds = {
        task: ", ".join(str(e.meta.seed) for e in episodes if e.meta.task == task)
        for task in source.tasks
    }
    return _CARD.format(
        episodes=len(episodes),
        successes=sum(selected.meta.success for selected in episodes),
        frames=source.frames,
        rate=RATE,
        axes=AXES,
        operators=" ".join(
            f"**{count} of {len(episodes)} are by {_OPERATORS[operator]}**."
            for operator, count in source.operators.items()
        ),
        tasks="\n".join(f"| {t} | {source.goals[t]} | {seeds[t]} |" for t in source.tasks),
        state=_rows(source.columns.state),
        action=_rows(source.columns.action),
    )


def _rows(ranges: Sequence[ColumnRange]) -> str:
    """Return a row ``| 0-27 | feet and hands ... |`` for each range."""
    rows, first = [], 0
    for columns in ranges:
        last = first + len(columns.names) - 1
        rows.append(
            f"| {first}-{last} | {columns.doc} |"
            if last > first
            else f"| {first} | {columns.doc} |"
        )
        first = last + 1
    return "\n".join(rows)
