"""Describe the scored tasks and draw their scenes, for ``trill tasks``."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from common.links.spec import PRESETS
from lab.errors import LabError
from lab.progress import ProgressBar
from services.sim.model.world import build_model
from services.sim.scenes import SCENES
from services.sim.tasks import Task, all_tasks
from services.sim.tasks.contacts import object_of

PICTURES = Path("docs/tasks")


def sheet_name(task: str) -> str:
    """Return the file name of the contact sheet of a success."""
    return f"{task.replace('/', '-')}.jpg"


def task_table(tasks: list[Task]) -> Table:
    """Return a table of the tasks; its last column names a contact sheet of a success."""
    table = Table(show_lines=True)
    for title in ("task", "goal", "limit", "a success if", f"in {PICTURES}"):
        table.add_column(title, overflow="fold")
    for column in (0, 2, 4):
        table.columns[column].no_wrap = True
    for task in tasks:
        table.add_row(task.name, task.goal, f"{task.limit:g} s", task.rule, sheet_name(task.name))
    return table


def describe_task(task: Task) -> str:
    """Return everything about one task as plain text."""
    scene = SCENES[task.scene]
    stages = [
        f"  {i}. {stage.name}"
        + (f", for {stage.hold:g} s" if stage.hold else "")
        + (f", after: {stage.after}" if stage.after else "")
        + (" (part of the task)" if stage.partial else "")
        for i, stage in enumerate(task.stages, start=1)
    ]
    noise = "typical state noise" if task.noise.position else "no state noise"
    lines = [
        f"{task.name}: {task.goal}",
        "",
        f"scene       {scene.name}: {scene.doc}",
        f"time limit  {task.limit:g} s from the first command that the plant applies",
        f"success     {task.rule}",
        "partial     the goal with an undesired contact, or some part of the task in time",
        "failure     a fall, or nothing done in time"
        + "".join(f", or: {wrong.name}" for wrong in task.failures),
        f"conditions  {noise}" + _own_link(task),
        f"origin      {task.origin}",
        f"pictures    {PICTURES / sheet_name(task.name)} (a success of the synthetic operator), "
        f"{PICTURES / task.scene}.jpg (the scene)",
        "",
        "stages, the last is the goal:",
        *stages,
        "",
        "desired contacts (every other one of robot and scene is undesired):",
        *([f"  {pair}" for pair in sorted(task.desired)] or ["  none"]),
        "",
        f"undesired contacts, for instance: {', '.join(_undesired(task))}",
        f"operators see: {', '.join((*task.objects, *task.joints, *task.marks))}",
    ]
    return "\n".join(lines)


def _own_link(task: Task) -> str:
    if not task.link:
        return "; no link of its own"
    links = "; ".join(f"{name}={spec}" for name, spec in task.links.items())
    meant = PRESETS.get(task.link)
    return f"; link: {links}{f', that is {meant},' if meant else ''} unless others are given"


def _undesired(task: Task) -> list[str]:
    """Return the undesired pairs that are possible in the scene, with the likeliest parts."""
    model = build_model(task.scene, visuals=False)
    # The robot's collision shapes use the first collision bit.
    reachable = (model.geom_contype | model.geom_conaffinity) & 1
    names = [model.geom(i).name for i in range(model.ngeom) if reachable[i]]
    things = dict.fromkeys(object_of(name) for name in names if "." in name)
    likely = ("wrist", "elbow", "knee", "foot", "chest", "finger")
    wanted = {str(pair) for pair in task.desired}
    every = [f"{part} on {thing}" for thing in things for part in likely]
    return [pair for pair in every if pair not in wanted]


def physics_table() -> str:
    """Return masses, frictions and springs of all scenes as Markdown."""
    lines: list[str] = []
    for scene in SCENES.values():
        if not scene.physics:
            continue
        lines += [
            f"## {scene.name}: {scene.doc}",
            "",
            "| quantity | value | why |",
            "|---|---|---|",
        ]
        lines += [
            f"| {row.what} | {f'{row.value:g} {row.unit}'.strip()} | {row.why} |"
            for row in scene.physics
        ]
        lines.append("")
    return "\n".join(lines)


def draw_scenes(console: Console, directory: Path) -> None:
    """Draw every scene into a directory, with a progress bar.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        LabError: the directory cannot be written.
    """
    # It needs OpenGL, which the other functions do not.
    from services.sim.rendering.task_sheet import write_sheets

    scenes = {task.scene for task in all_tasks().values()}
    with ProgressBar("drawing the scenes", total=len(scenes), console=console) as bar:
        try:
            for path in write_sheets(directory):
                bar.advance()
                bar.say(f"{path}  {path.stat().st_size / 1000:.0f} kB")
        except OSError as error:
            raise LabError(f"cannot write in {directory}: {error.strerror}") from error
