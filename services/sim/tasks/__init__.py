"""Scored tasks: definitions, contacts, judge and trials."""

from services.sim.tasks.base import Task
from services.sim.tasks.registry import all_tasks, find_task

__all__ = ["Task", "all_tasks", "find_task"]
