"""The README of an exported data set: what it is, and what each number means."""

from common.episodes.episode_file import RATE
from lab.demonstrations.export.fields import ACTION, STATE, described
from lab.demonstrations.export.source import Source, goal_of, seeds

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
    synthetic = [chosen for chosen in source.episodes if chosen.meta.synthetic]
    done = sum(chosen.meta.success for chosen in source.episodes)
    parts = [
        _FRONT + "# Demonstrations by the DRACO 3 humanoid in simulation",
        f"{len(source.episodes)} episodes ({done} successes), {source.frames} frames at {RATE} Hz, "
        f"in lerobot's format v3.0. **{len(synthetic)} of {len(source.episodes)} are by a "
        "synthetic operator**: a programme that stands in for a person, not a person. Made by "
        "trill; `meta/trill.json` says from what, episode by episode.",
        _tasks(source),
        _table("observation.state", described(STATE)),
        _table("action", described(ACTION)),
        _REST,
    ]
    return "\n\n".join(parts) + "\n"


def _tasks(source: Source) -> str:
    lines = ["| task | goal | seeds |", "|---|---|---|"]
    for task in source.tasks:
        chosen = [one for one in source.episodes if one.meta.task == task]
        lines.append(f"| {task} | {goal_of(task)} | {seeds(chosen)} |")
    return "\n".join(lines)


def _table(title: str, rows: list[tuple[str, str]]) -> str:
    lines = [f"## {title}", "", "| columns | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {columns} | {doc} |" for columns, doc in rows)])


_REST = """`meta/info.json` names each column. Numbers are as collected, in float32; nothing is
scaled. The body frame is `torso_link` (x forward, y left, z up); quaternions are (w, x, y, z).
Locomotion and controller state are numbers of kinds, not quantities.

A frame's action was given at that frame; its observation is the newest that the robot then had.
`age.*` says how old that was [s]: joints (`state`), controller state, pictures (`truth`), and what
the operator acted on (`seen`), which a delayed link makes older. `next.success` is true in the
frame whose action the judge called a success, and after it; `next.done` in the last."""
