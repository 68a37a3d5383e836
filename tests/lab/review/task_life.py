"""Messages of a run with a scored task, for tests."""

from collections.abc import Sequence

from common.schemas import (
    OperatorStatus,
    PlantAction,
    PlantRequest,
    SceneState,
    ServiceHealth,
    TaskStage,
    TaskStatus,
    TaskVerdict,
    UndesiredContact,
)
from common.topics import PLANT_REQUEST, PLANT_TRUTH, TASK_SCENE, TASK_STATUS, TELEOP_STATUS
from tests.lab.review.synthetic import Life, Pair

STAGES = ("lever pressed", "door ajar", "door unlocked")
START_MS = 1500
"""Robot time at which the trial's clock starts."""


def status(
    life: Life,
    done: int = 0,
    verdict: TaskVerdict = TaskVerdict.RUNNING,
    *,
    touched: Sequence[str] = (),
    resets: int = 0,
    time: float | None = None,
) -> Pair:
    """What the judge says now; without ``time`` as the clock says."""
    elapsed = max(0, life.now - START_MS) / 1000 if time is None else time
    return TASK_STATUS, TaskStatus(
        header=life.header(TASK_STATUS, "sim"),
        task="door/unlock",
        seed=7,
        time=elapsed,
        limit=60.0,
        verdict=verdict,
        reason="" if verdict is TaskVerdict.RUNNING else f"it was a {verdict.name.lower()}",
        stages=[TaskStage(name=name, done=i < done) for i, name in enumerate(STAGES)],
        undesired=[
            UndesiredContact(name=name, since=min(elapsed, 5.0), peak=12.0) for name in touched
        ],
        reset_count=resets,
    )


def operator(life: Life, label: str = "to the lever", failed: str = "") -> Pair:
    return TELEOP_STATUS, OperatorStatus(
        header=life.header(TELEOP_STATUS, "teleop"),
        script="synthetic door/unlock",
        step=int(bool(failed)),
        steps=1,
        label=label,
        finished=bool(failed),
        failed=failed,
    )


def scene(life: Life, hinge: float) -> Pair:
    """The door's hinge [rad]; the lever stays."""
    header = life.header(TASK_SCENE, "sim")
    return TASK_SCENE, SceneState(header=header, scene="door", qpos=[hinge, 0.0, 0.0])


def stand(life: Life, steps: int, hinge: float = 0.0) -> list[Pair]:
    """Scene and robot 100 ms apart."""
    pairs = []
    for _ in range(steps):
        life.now += 100
        pairs += [scene(life, hinge), life.plant(PLANT_TRUTH, 0.0, 0.0, 0.0)]
    return pairs


def unlocked(life: Life, verdict: TaskVerdict = TaskVerdict.SUCCESS) -> list[Pair]:
    """A whole trial: half a second until the clock starts, then 6 s."""
    touched = () if verdict is TaskVerdict.SUCCESS else ("left wrist on jamb",)
    return [
        *[*stand(life, 5), status(life), operator(life)],
        *[*stand(life, 1), status(life)],
        *[*stand(life, 29, 0.0), status(life, 1)],
        *[*stand(life, 20, 0.1), status(life, 2, touched=touched)],
        *[*stand(life, 10, 0.2), status(life, 3, verdict, touched=touched)],
        *[*stand(life, 5, 0.2), status(life, 3, verdict, touched=touched, time=6.0)],
    ]


def health(life: Life, service: str, boot: int) -> ServiceHealth:
    """A sign of life of a service's life number ``boot``."""
    message = life.health(service, misses=0, median=0.001, p99=0.002)[1]
    assert isinstance(message, ServiceHealth)
    header = message.header.model_copy(update={"boot": boot})
    return message.model_copy(update={"header": header})


def reset_by(life: Life, source: str, seed: int = -1) -> Pair:
    """Somebody asks for a reset."""
    header = life.header(PLANT_REQUEST, source)
    return PLANT_REQUEST, PlantRequest(header=header, action=PlantAction.RESET, seed=seed)
