"""Registry of the tasks: the tuple ``TASKS`` of every module in this package.

To add a task, add a :class:`~services.sim.tasks.base.Task` to such a tuple, or add a module.
"""

import importlib
import pkgutil
from functools import cache

from services.sim.config import SimConfig
from services.sim.errors import TaskError
from services.sim.tasks.base import Task

_PACKAGE = "services.sim.tasks"


@cache
def all_tasks() -> dict[str, Task]:
    """Return every task by name, sorted.

    Raises:
        TaskError: a task's name does not begin with the name of its module, or exists twice.
    """
    found: dict[str, Task] = {}
    package = importlib.import_module(_PACKAGE)
    for info in pkgutil.iter_modules(package.__path__):
        module = importlib.import_module(f"{_PACKAGE}.{info.name}")
        for task in getattr(module, "TASKS", ()):
            if not task.name.startswith(f"{info.name}/") or task.name in found:
                raise TaskError(
                    f"expected a unique task name {info.name}/<task> in {module.__name__}, got "
                    f"{task.name!r}"
                )
            found[task.name] = task
    return dict(sorted(found.items()))


def find_task(name: str) -> Task:
    """Return the task called ``name``.

    Raises:
        TaskError: there is no such task.
    """
    tasks = all_tasks()
    if name not in tasks:
        raise TaskError(f"unknown task {name!r}: expected one of {', '.join(tasks)}")
    return tasks[name]


def with_task(config: SimConfig) -> SimConfig:
    """Return ``config`` with the scene of its task and, unless given, the noise of its task.

    Raises:
        TaskError: the task is unknown, or another scene is configured too.
    """
    if not config.task:
        return config
    task = find_task(config.task)
    given = config.model_fields_set
    if "scene" in given and config.scene != task.scene:
        raise TaskError(
            f"the task {task.name} needs the scene {task.scene!r}, got {config.scene!r}; leave the "
            "scene out"
        )
    noise = config.noise if "noise" in given else task.noise
    return config.model_copy(update={"scene": task.scene, "noise": noise})
