"""Episodes made by a Ray cluster of two workers are those made here."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common.episodes.folder import IndexLine
from lab.demonstrations.collect.collect import CollectionProgress, collect
from lab.demonstrations.collect.episode import make_episode
from lab.demonstrations.collect.store import DatasetStore
from lab.errors import LabError
from lab.trials.executors import RayExecutor
from tests.lab.demonstrations.collect.support import CONFIG

ray = pytest.importorskip("ray")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Two nodes with one processor each."""
    from ray.cluster_utils import Cluster

    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    nodes.add_node(num_cpus=1)
    try:
        yield nodes
    finally:
        nodes.shutdown()


def test_the_same_bytes_from_a_cluster_that_loses_a_node(cluster: Any, tmp_path: Path) -> None:
    executors: list[RayExecutor] = []
    doomed = cluster.add_node(num_cpus=1)
    said: list[str] = []
    ticks: list[int] = []

    def open_executor() -> RayExecutor:
        executors.append(RayExecutor(cluster.address, None))
        return executors[0]

    def tell(progress: CollectionProgress, _line: IndexLine | None) -> None:
        # Every node has an episode under way when one is killed.
        ticks.append(len(progress.lines))
        if len(ticks) == 12:
            cluster.remove_node(doomed, allow_graceful=False)

    progress = collect(
        CONFIG,
        DatasetStore(tmp_path),
        open_executor,
        wanted=3,
        max_trials=8,
        on_progress=tell,
        on_message=said.append,
    )
    assert executors[0].size == 3
    assert ticks[11] < 3
    assert any("nodes now" in text for text in said)
    assert progress.complete
    # One made here: the same bytes.
    line = next(line for line in progress.lines.values() if line.kept)
    assert (tmp_path / line.file).read_bytes() == make_episode(CONFIG, line.meta.seed).content


def test_no_cluster_is_told() -> None:
    with pytest.raises(LabError, match="no Ray cluster"):
        RayExecutor("127.0.0.1:1", 1)
