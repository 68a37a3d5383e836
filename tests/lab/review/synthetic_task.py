"""Messages of a fake robot that does a scored task, for tests."""

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
from tests.lab.review.synthetic import FakeRobot, Pair

STAGES = ("lever pressed", "door ajar", "door unlocked")
START_MS = 1500
"""Robot time at which the trial's clock starts."""


def status(
    robot: FakeRobot,
    done: int = 0,
    verdict: TaskVerdict = TaskVerdict.RUNNING,
    *,
    touched: Sequence[str] = (),
    resets: int = 0,
    time: float | None = None,
) -> Pair:
    """A status of the judge; without ``time`` at the time of the robot's clock."""
    elapsed = max(0, robot.now - START_MS) / 1000 if time is None else time
    return TASK_STATUS, TaskStatus(
        header=robot.header(TASK_STATUS, "sim"),
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


def operator(robot: FakeRobot, label: str = "to the lever", failed: str = "") -> Pair:
    return TELEOP_STATUS, OperatorStatus(
        header=robot.header(TELEOP_STATUS, "teleop"),
        script="synthetic door/unlock",
        step=int(bool(failed)),
        steps=1,
        label=label,
        finished=bool(failed),
        failed=failed,
    )


def scene(robot: FakeRobot, hinge: float) -> Pair:
    """The scene with the door's hinge at an angle [rad] and the lever at rest."""
    header = robot.header(TASK_SCENE, "sim")
    return TASK_SCENE, SceneState(header=header, scene="door", qpos=[hinge, 0.0, 0.0])


def stand(robot: FakeRobot, steps: int, hinge: float = 0.0) -> list[Pair]:
    """Scene and robot 100 ms apart."""
    pairs = []
    for _ in range(steps):
        robot.now += 100
        pairs += [scene(robot, hinge), robot.plant(PLANT_TRUTH, 0.0, 0.0, 0.0)]
    return pairs


def unlocked(robot: FakeRobot, verdict: TaskVerdict = TaskVerdict.SUCCESS) -> list[Pair]:
    """A whole trial: half a second until the clock starts, then 6 s."""
    touched = () if verdict is TaskVerdict.SUCCESS else ("left wrist on jamb",)
    return [
        *[*stand(robot, 5), status(robot), operator(robot)],
        *[*stand(robot, 1), status(robot)],
        *[*stand(robot, 29, 0.0), status(robot, 1)],
        *[*stand(robot, 20, 0.1), status(robot, 2, touched=touched)],
        *[*stand(robot, 10, 0.2), status(robot, 3, verdict, touched=touched)],
        *[*stand(robot, 5, 0.2), status(robot, 3, verdict, touched=touched, time=6.0)],
    ]


def health(robot: FakeRobot, service: str, boot: int) -> ServiceHealth:
    """A health message of a service with this boot id."""
    message = robot.health(service, misses=0, median=0.001, p99=0.002)[1]
    assert isinstance(message, ServiceHealth)
    header = message.header.model_copy(update={"boot": boot})
    return message.model_copy(update={"header": header})


def reset_by(robot: FakeRobot, source: str, seed: int = -1) -> Pair:
    """A request to reset the plant."""
    header = robot.header(PLANT_REQUEST, source)
    return PLANT_REQUEST, PlantRequest(header=header, action=PlantAction.RESET, seed=seed)
