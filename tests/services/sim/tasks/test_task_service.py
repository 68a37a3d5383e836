"""Tasks on the bus: status, scene, seeds, noise, determinism, and pictures of true objects."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.schemas import PlantAction, PlantRequest, SceneState, TaskStatus, TaskVerdict
from common.topics import (
    PLANT_REQUEST,
    PLANT_TRUTH,
    TASK_SCENE,
    TASK_STATUS,
    WBC_COMMAND,
    Topic,
)
from services.sim.config import TYPICAL_NOISE, NoiseConfig, SimConfig
from services.sim.errors import RenderingUnavailableError, SceneError, TaskError
from services.sim.model.robot_state import show_state
from services.sim.physics.plant import Plant
from services.sim.rendering.cameras import CameraConfig, CameraService
from services.sim.service import PlantService
from services.sim.tasks import registry
from tests.services.inputs import FakeInputs
from tests.services.sim.support import MS, Stander


class Bench:
    """Steps a plant on a clock of its own; a stander commands it."""

    def __init__(self, *, driven: bool = True, **settings: Any) -> None:
        self.service = PlantService(SimConfig(**settings))
        self.plant = self.service.plant
        self.inputs = FakeInputs()
        self.now_ns = 5_000 * MS
        self.outputs: list[Any] = []
        self._stander = Stander(self.plant) if driven else None

    def run(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            self.now_ns += MS
            if self._stander and self.plant.steps % 10 == 5:
                command = self._stander.command(self.plant.truth())
                self.inputs.put(WBC_COMMAND, command)
            self.outputs += self.service.step(self.inputs, self.now_ns)
            self.inputs.begin_step()

    def ask(self, **values: Any) -> None:
        self.inputs.put(PLANT_REQUEST, PlantRequest(**values))

    def said(self, topic: Topic[Any]) -> list[Any]:
        return [output.message for output in self.outputs if output.topic is topic]

    @property
    def status(self) -> TaskStatus:
        status: TaskStatus = self.said(TASK_STATUS)[-1]
        return status

    @property
    def scene(self) -> SceneState:
        scene: SceneState = self.said(TASK_SCENE)[-1]
        return scene


def test_status_at_10_hertz_and_scene_with_the_truth() -> None:
    bench = Bench(task="door/unlock", seed=7)
    bench.run(1000)
    assert 10 <= len(bench.said(TASK_STATUS)) <= 12
    stamps = [m.header.stamp for m in bench.said(TASK_SCENE)]
    assert stamps == [m.header.stamp for m in bench.said(PLANT_TRUTH)]
    assert len(stamps) == 50
    status = bench.status
    assert (status.task, status.seed, status.limit) == ("door/unlock", 7, 20.0)
    assert status.verdict is TaskVerdict.RUNNING
    assert status.stages[0].name == "lever pressed"
    assert {thing.name for thing in bench.scene.objects} == {"leaf", "lever", "lever_grip"}
    assert [mark.name for mark in bench.scene.marks] == ["goal"]
    assert bench.scene.scene == "door"
    assert set(bench.service.writes) >= {TASK_SCENE, TASK_STATUS}


def test_a_plant_without_a_task_says_nothing_about_one() -> None:
    bench = Bench()
    bench.run(200)
    assert bench.said(TASK_STATUS) == bench.said(TASK_SCENE) == []
    assert not {TASK_SCENE, TASK_STATUS} & set(bench.service.writes)


def test_a_scene_without_a_task_is_told_too() -> None:
    bench = Bench(scene="door")
    bench.run(50)
    assert bench.said(TASK_STATUS) == []
    assert bench.scene.task == ""
    assert len(bench.scene.qpos) == 3


def test_a_change_is_told_at_once_and_the_verdict_lasts_until_the_reset() -> None:
    bench = Bench(task="door/unlock", seed=7)
    bench.run(203)
    bench.plant.data.joint("door_lever").qfrc_applied[:] = 1.5
    bench.plant.data.joint("door_hinge").qfrc_applied[:] = 5.0
    bench.run(700)
    bench.plant.data.joint("door_hinge").qfrc_applied[:] = 0.0
    bench.run(900)
    said = bench.said(TASK_STATUS)
    first = next(m for m in said if m.stages[0].done)
    before = said[said.index(first) - 1]
    assert first.header.stamp - before.header.stamp < 100 * MS
    assert bench.status.verdict.name == "SUCCESS"
    assert bench.status.reason.startswith("door unlocked in 1.")
    bench.ask(action=PlantAction.RESET)
    bench.run(25)
    assert bench.status.verdict is TaskVerdict.RUNNING
    assert bench.status.seed == 8
    assert not any(stage.done for stage in bench.status.stages)
    assert bench.scene.reset_count == bench.status.reset_count == 1


def test_a_reset_takes_the_next_seed_or_the_one_it_names() -> None:
    bench = Bench(task="bench/hammer", seed=7)
    bench.run(20)
    first = bench.scene.qpos
    for seed, expected in ((-1, 8), (7, 7), (123, 123), (-1, 11)):
        bench.ask(action=PlantAction.RESET, seed=seed)
        bench.run(21)
        assert bench.status.seed == expected
        # To where the things have settled, which takes a few hundredths of a millimetre.
        assert np.allclose(bench.scene.qpos, first, atol=1e-4) == (expected == 7)


def test_the_clock_starts_with_the_first_command() -> None:
    silent, driven = Bench(driven=False, task="door/walk"), Bench(task="door/walk")
    for bench in (silent, driven):
        bench.run(300)
    assert silent.status.time == 0.0
    assert 0.15 < driven.status.time <= 0.3


def test_a_fall_in_the_physics_is_a_failure() -> None:
    bench = Bench(task="door/walk")
    bench.run(50)
    bench.plant.push(np.array([-400.0, 0.0, 0.0]), 0.4)
    bench.run(1500)
    assert (bench.status.verdict, bench.status.reason) == (TaskVerdict.FAILURE, "the robot fell")


@pytest.mark.parametrize("task", ["bench/hammer", "hardware/cap"])
def test_the_same_seed_gives_the_same_bytes(task: str) -> None:
    def play(seed: int) -> bytes:
        bench = Bench(task=task, seed=seed)
        bench.run(300)
        return repr([output.message.model_dump() for output in bench.outputs]).encode()

    assert play(3) == play(3)
    assert play(3) != play(4)


def test_hardware_tasks_have_noise_unless_given() -> None:
    assert Plant(SimConfig(task="hardware/tool")).config.noise == TYPICAL_NOISE
    assert Plant(SimConfig(task="hardware/tool", noise=NoiseConfig())).config.noise == NoiseConfig()
    assert Plant(SimConfig(task="door/walk")).config.noise == NoiseConfig()


def test_a_task_brings_its_scene_and_bears_no_other() -> None:
    assert Plant(SimConfig(task="door/walk")).config.scene == "door"
    with pytest.raises(TaskError, match="scene 'door', got 'bench'"):
        Plant(SimConfig(task="door/walk", scene="bench"))
    with pytest.raises(TaskError, match="unknown task"):
        Plant(SimConfig(task="door/fly"))


def test_a_replayed_plant_is_the_same() -> None:
    service = PlantService(SimConfig(task="hardware/tool", seed=2))
    again = PlantService.from_settings(service.settings)
    assert again.plant.config == service.plant.config
    assert again.plant.data.qpos.tobytes() == service.plant.data.qpos.tobytes()


def test_a_new_module_brings_new_tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import services.sim.tasks as package

    (tmp_path / "moon.py").write_text(
        "from dataclasses import replace\n"
        "from services.sim.tasks.door import WALK\n"
        "TASKS = (replace(WALK, name='moon/dance'),)\n"
    )
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    before = set(registry.all_tasks())
    registry.all_tasks.cache_clear()
    try:
        assert registry.find_task("moon/dance").scene == "door"
        assert set(registry.all_tasks()) == before | {"moon/dance"}
    finally:
        registry.all_tasks.cache_clear()
        for name in [name for name in sys.modules if "tasks.moon" in name]:
            del sys.modules[name]


@pytest.fixture(scope="module")
def cameras() -> Any:
    try:
        service = CameraService(CameraConfig(encoding="rgb8", width=200, height=150))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    yield service
    service.close()


def picture(service: CameraService, plant: Plant) -> Any:
    inputs = FakeInputs()
    inputs.put(TASK_SCENE, plant.view.state(plant.now_ns, 0))
    inputs.put(PLANT_TRUTH, plant.truth())
    frame: Any = service.step(inputs, 0)[0].message
    return np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3).astype(float)


def blue(image: Any) -> float:
    """Share of the picture that has the door's colour."""
    return float(((image[..., 2] > image[..., 0] + 25) & (image[..., 2] > 60)).mean())


def test_the_cameras_follow_the_plants_scene_and_see_its_objects(cameras: Any) -> None:
    plant = Plant(SimConfig(task="door/walk"))
    plant.data.joint("neck_pitch").qpos[:] = 0.2
    closed = picture(cameras, plant)
    plant.data.joint("door_hinge").qpos[:] = 1.5
    opened = picture(cameras, plant)
    assert blue(closed) > 0.15
    assert np.abs(opened - closed).mean() > 4.0
    plant.data.joint("door_hinge").qpos[:] = 0.0
    np.testing.assert_array_equal(picture(cameras, plant), closed)


def test_objects_of_another_scene_are_refused() -> None:
    door, bench = (Plant(SimConfig(task=task)) for task in ("door/walk", "bench/walk"))
    with pytest.raises(SceneError, match=r"expected 10 joint values.*got 3"):
        show_state(bench.model, bench.data, bench.addresses, door.truth(), door.view.state(0, 0))


def test_the_command_line_knows_the_tasks(capsys: pytest.CaptureFixture[str]) -> None:
    from lab.cli.main import main
    from lab.monitor.tasks_text import describe_task, physics_table

    assert main(["tasks"]) == 0
    assert "hardware/cap" in capsys.readouterr().out
    assert main(["tasks", "door/unlock"]) == 0
    assert "wrist on jamb" in capsys.readouterr().out.replace("\n", " ")
    assert main(["tasks", "moon"]) == 2
    assert "| leaf, mass | 10 kg |" in physics_table()
    assert all(task.rule in describe_task(task) for task in registry.all_tasks().values())
