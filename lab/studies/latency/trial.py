"""Runs one trial of the study and measures it."""

from functools import partial
from time import perf_counter
from typing import Any

from lab.studies.latency.conditions import FEEDBACK_INPUT
from lab.studies.latency.meter import MEASURED_TOPICS, TrialMeter, judged_values
from lab.studies.latency.plan import Plan, TrialKey, study_code
from lab.studies.latency.record import StudyTrial
from lab.trials.stack import TaskStack
from services.sim.tasks import find_task


def run_study_trial(plan: Plan, key: TrialKey) -> StudyTrial:
    """Run one trial and measure it; if its simulation fails the verdict is ``error``.

    Raises:
        StoppedError: the worker is to end meanwhile.
        LabError: this process runs other code than the study was begun with.
    """
    plan.code.check(study_code(plan.operator))
    began = perf_counter()
    stack = TaskStack(plan.spec(key), journal=True)
    meter = TrialMeter()
    for topic in MEASURED_TOPICS:
        stack.runner.on_message(topic, partial(meter.add, topic))
    result = stack.run_or_error()
    values: dict[str, Any] = {"limit": find_task(key.task).limit, "reached": False}
    if stack.status is not None:
        values |= judged_values(stack.status)
    values |= result.model_dump(include={"verdict", "time", "reason", "gave_up", "doing"})
    if result.verdict == "error":
        values["reached"] = False
    return StudyTrial(
        task=key.task,
        condition=key.condition,
        seed=key.seed,
        simulated=result.simulated,
        wall=perf_counter() - began,
        **values,
        **meter.values(plan.condition(key.condition), [FEEDBACK_INPUT]),
    )
