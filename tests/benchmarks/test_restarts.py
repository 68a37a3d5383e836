"""A controller that is killed under ``trill up`` is back before the robot notices much."""

import os
from pathlib import Path

import pytest

from benchmarks.bench_start import HELP, measure_starts
from benchmarks.builds import OWN_ROOT, Build, own_and
from benchmarks.restarts import restarts
from common.schemas import GuardMode
from tests.lab.live.test_end_to_end import left_behind


def test_a_killed_controller_commands_again_within_1_5_s(tmp_path: Path) -> None:
    found = restarts(own_and(None)[0], 2, tmp_path)
    assert len(found) == 2
    for restart in found:
        assert 0.01 < restart.seconds < 1.5
        assert restart.guards <= {GuardMode.ACTIVE, GuardMode.HOLD}
    assert left_behind(tmp_path) == []


def test_two_builds_are_timed_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    package = other / "pack"
    package.mkdir(parents=True)
    (other / "pyproject.toml").write_text('[project.scripts]\ntrill = "pack.cli:run"\n')
    (package / "__init__.py").write_text("")
    (package / "cli.py").write_text("import time\ndef run():\n    time.sleep(0.5)\n")
    builds = own_and(other)
    assert builds == [Build("ours", OWN_ROOT), Build("against", other)]
    assert builds[1].environment["PYTHONPATH"] == str(other)
    assert builds[1].environment["PATH"] == os.environ["PATH"]
    assert builds[0].has("services.wbc.__main__")
    assert not builds[1].has("services.wbc.__main__")
    monkeypatch.setattr("benchmarks.bench_start.MODULES", ("deploy.child",))
    costs = measure_starts(builds, 1, tmp_path)
    assert list(costs["deploy.child"]) == ["ours"]
    assert len(costs[HELP]["ours"]) == len(costs[HELP]["against"]) == 1
    cost = costs[HELP]["against"][0]
    assert cost.elapsed > 0.5
    assert 0.0 < cost.cpu < cost.elapsed
