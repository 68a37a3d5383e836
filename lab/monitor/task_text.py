"""How a scored task stands, for the live table."""

from rich.text import Text

from common.schemas import TaskStatus, TaskVerdict

_STYLES = {
    TaskVerdict.RUNNING: "",
    TaskVerdict.SUCCESS: "bold green",
    TaskVerdict.PARTIAL: "yellow",
    TaskVerdict.FAILURE: "bold red",
}


def task_words(task: TaskStatus) -> str:
    """Task, time, verdict, stages and undesired contacts in one line."""
    return f"{_which(task)} {_verdict(task)}, {_stages(task)}, {_undesired(task)}"


def task_line(task: TaskStatus) -> Text:
    """The same for a terminal."""
    return Text.assemble(
        ("task        ", "dim"),
        f"{_which(task)}  ",
        (_verdict(task), _STYLES[task.verdict]),
        f"  {_stages(task)}  ",
        (_undesired(task), "yellow" if task.undesired else "dim"),
        no_wrap=True,
        overflow="ellipsis",
    )


def _which(task: TaskStatus) -> str:
    return f"{task.task} seed {task.seed}  {task.time:.1f}/{task.limit:g} s"


def _verdict(task: TaskStatus) -> str:
    reason = "" if task.verdict is TaskVerdict.SUCCESS else task.reason
    return task.verdict.name + (f": {reason}" if reason else "")


def _stages(task: TaskStatus) -> str:
    done = [stage.name for stage in task.stages if stage.done]
    wanted = [stage.name for stage in task.stages if not stage.done]
    text = f"stage {len(done)}/{len(task.stages)}"
    if done:
        text += f": {done[-1]}"
    running = task.verdict is TaskVerdict.RUNNING
    return f"{text}, next: {wanted[0]}" if wanted and running else text


def _undesired(task: TaskStatus) -> str:
    names = ", ".join(touch.name for touch in task.undesired)
    return f"undesired: {names}" if names else "nothing undesired touched"
