"""Finds the tasks: every package below this one that defines ``TASK``.

A further task is a folder ``<group>/<task>`` with an ``__init__.py`` that defines it; nothing else
has to be told.
"""

import importlib
import pkgutil
from functools import cache

from services.sim.errors import TaskError
from services.sim.tasks.base import Task

_PACKAGE = "services.sim.tasks"


@cache
def all_tasks() -> dict[str, Task]:
    """Every task by name, sorted.

    Raises:
        TaskError: a folder's task is not called like the folder.
    """
    found = {}
    package = importlib.import_module(_PACKAGE)
    for info in pkgutil.walk_packages(package.__path__, prefix=f"{_PACKAGE}."):
        if not info.ispkg:
            continue
        task = getattr(importlib.import_module(info.name), "TASK", None)
        if task is None:
            continue
        folder = info.name.removeprefix(f"{_PACKAGE}.").replace(".", "/")
        if task.name != folder:
            raise TaskError(f"expected the task in {folder} to be called so, got {task.name!r}")
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
