"""Print the CPU time of one stereo pair, rendered and encoded, over all scenes.

    python benchmarks/workloads/pictures.py [--pairs N]

Head and arms move from pair to pair. Results: ``pair_ms``, the mean over the scenes, and each
scene's median, ``flat_ms`` and so on. CPU time is that of the process with all of its threads.
"""

import argparse
import json
from statistics import fmean, median
from time import process_time

import numpy as np

from common.robot.frames import CAMERAS
from common.robot.joints import LEFT_ARM, NECK
from common.schemas import PlantState, SceneState
from services.sim.config import SimConfig
from services.sim.physics.plant import Plant
from services.sim.rendering.cameras import CameraConfig, StereoRenderer, encode
from services.sim.scenes import SCENES
from services.sim.tasks.registry import all_tasks

WARM_UP = 2
"""Pairs that are not counted: first use of every texture and shader."""


def moved(state: PlantState, index: int) -> PlantState:
    """Return ``state`` with the head and the left arm elsewhere, looking down at the hands."""
    position = state.joint_position.copy()
    position[NECK] = 0.45 + 0.1 * np.sin(0.7 * index)
    position[LEFT_ARM] += 0.1 * np.sin(0.3 * index)
    return state.model_copy(update={"joint_position": position})


def start_of(scene: str) -> tuple[PlantState, SceneState]:
    """Return robot and objects at the start of the first task in ``scene``, if it has one."""
    task = next((task.name for task in all_tasks().values() if task.scene == scene), "")
    plant = Plant(SimConfig(task=task) if task else SimConfig(scene=scene))
    return plant.truth(), plant.view.state(plant.now_ns, 0)


def pair_times(scene: str, pairs: int) -> list[float]:
    """Return the CPU time of each of ``pairs`` pairs [s]."""
    state, objects = start_of(scene)
    config = CameraConfig(scene=scene)
    renderer = StereoRenderer(config)
    times = []
    for index in range(WARM_UP + pairs):
        shown = moved(state, index)
        began = process_time()
        for image in renderer.render(shown, list(CAMERAS), objects):
            encode(image, config.encoding, config.quality)
        times.append(process_time() - began)
    renderer.close()
    return times[WARM_UP:]


def main() -> int:
    """Render and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=20, help="counted pairs of each scene (20)")
    pairs = parser.parse_args().pairs
    scenes = {f"{scene}_ms": 1e3 * median(pair_times(scene, pairs)) for scene in sorted(SCENES)}
    print(json.dumps({"pair_ms": fmean(scenes.values()), **scenes}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
