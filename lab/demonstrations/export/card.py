"""The README of an exported data set: what it is, and what each number means."""

from common.episodes.episode_file import RATE
from lab.demonstrations.export.fields import ACTION, STATE, described
from lab.demonstrations.export.source import Source, seeds

_FRONT = """---
task_categories:
- robotics
tags:
- LeRobot
- trill
configs:
- config_name: default
  data_files: data/*/*.parquet
---
"""


def card(source: Source) -> str:
    """The text, in Markdown with the head that dataset hubs read."""
    done = sum(chosen.meta.success for chosen in source.episodes)
    parts = [
        _FRONT + "# Demonstrations by the DRACO 3 humanoid in simulation",
        f"{len(source.episodes)} episodes ({done} successes), {source.frames} frames at {RATE} Hz, "
        f"in lerobot's format v3.0. {_operators(source)} trill made them; `meta/trill.json` has "
        "the settings of each episode.",
        _tasks(source),
        _table("observation.state", described(STATE)),
        _table("action", described(ACTION)),
        _REST,
    ]
    return "\n\n".join(parts) + "\n"


_OPERATORS = {
    "synthetic": "a synthetic operator, which is a program that imitates a person",
    "person": "a person",
    "policy": "a learned policy",
}


def _operators(source: Source) -> str:
    """Who operated the robot, and in how many episodes."""
    parts = (
        f"**{number} of {len(source.episodes)} are by {_OPERATORS[operator]}**."
        for operator, number in source.operators.items()
    )
    return " ".join(parts)


def _tasks(source: Source) -> str:
    lines = ["| task | goal | seeds |", "|---|---|---|"]
    for task in source.tasks:
        chosen = [one for one in source.episodes if one.meta.task == task]
        lines.append(f"| {task} | {source.goals[task]} | {seeds(chosen)} |")
    return "\n".join(lines)


def _table(title: str, rows: list[tuple[str, str]]) -> str:
    lines = [f"## {title}", "", "| columns | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {columns} | {doc} |" for columns, doc in rows)])


_REST = """`meta/info.json` names each column. Numbers are as collected, in float32; nothing is
scaled. The body frame is `torso_link` (x forward, y left, z up); quaternions are (w, x, y, z).
Locomotion and controller state are numbers of kinds, not quantities.

A frame's action was given at that frame; its observation is the newest that the robot then had.
`age.*` says how old that was [s]: joints (`state`), controller state, stereo pair (`picture`), and
what the operator acted on (`seen`), which a delayed link makes older. `next.success` is true in the
frame whose action the judge called a success, and after it; `next.done` in the last."""
