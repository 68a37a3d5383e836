"""Scored tasks: starts, judges and what they see."""

from services.sim.tasks.base import Task
from services.sim.tasks.registry import all_tasks, find_task

__all__ = ["Task", "all_tasks", "find_task"]
