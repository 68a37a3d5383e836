"""The digest names every module that has a part in an episode, and nothing else."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lab.trials.provenance
from common.native import kernels
from lab.demonstrations.collect.config import collecting_code
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.provenance import ROOT, closure, digest, environment, machine, revision

WORK = """
import sys
from lab.demonstrations.collect.episode import make_episode
from lab.demonstrations.collect.config import EpisodeConfig
import services.sim.physics.plant as plant, dataclasses
found = plant.find_task
plant.find_task = lambda name: dataclasses.replace(found(name), limit=0.3)
for task in ("door/unlock", "bench/hammer"):
    make_episode(EpisodeConfig(task=task, physics_steps=5, pictures=None, keep_failures=True), 0)
for name in sorted(sys.modules):
    if name.split(".")[0] in ("common", "services", "lab", "deploy"): print(name)
"""


def test_every_module_that_worked_counts() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WORK], cwd=ROOT, capture_output=True, text=True, check=True
    )
    # Of a compiled kernel its source counts, as data beside the module that uses it.
    worked = set(done.stdout.split()) - kernels().keys()
    roots = ("lab.demonstrations.collect.episode", "lab.trials.operators.synthetic")
    counted = set(closure(*roots))
    assert collecting_code(SyntheticSpec()).source == digest(*roots)
    assert len(worked) > 60
    assert worked <= counted
    assert (
        not {
            "lab.demonstrations.collect.progress",
            "services.teleop.keyboard.service",
            "lab.cli.main",
        }
        & counted
    )


def test_a_changed_line_or_datum_is_another_digest_a_line_end_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "common").mkdir()
    for name, text in (
        ("__init__", ""),
        ("a", "def f():\n    from common import b\n"),
        ("b", "x = 1\n"),
        ("c", "unused = 1\n"),
    ):
        (tmp_path / "common" / f"{name}.py").write_bytes(text.encode())
    (tmp_path / "common" / "robot.xml").write_text("<robot/>")
    monkeypatch.setattr(lab.trials.provenance, "ROOT", tmp_path)

    def now() -> str:
        return digest.__wrapped__("common.a")

    first = now()
    (tmp_path / "common" / "c.py").write_text("unused = 2\n")
    (tmp_path / "common" / "b.py").write_bytes(b"x = 1\r\n")
    assert now() == first
    (tmp_path / "common" / "robot.xml").write_text("<robot mass='2'/>")
    second = now()
    (tmp_path / "common" / "b.py").write_text("x = 2\n")
    third = now()
    (tmp_path / "common" / "_b.c").write_text("int x = 2;")
    assert len({first, second, third, now()}) == 4


def test_an_import_counts_in_any_statement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "common").mkdir()
    names = [f"m{i}" for i in range(9)]
    for name in names:
        (tmp_path / "common" / f"{name}.py").write_text("")
    text = """
class A:
    async def f(self, x):
        async with x:
            import common.m0
        for _ in x:
            while x: from common.m1 import y
            else:
                from common import m2
try:
    import os; import common.m3 as z
except ImportError:
    from common import m4 as m
else:
    if (lambda: 3)():
        pass
    elif 2 if os else 3:
        from common.m5 import (
            a,
        )
finally:
    with open("x"):
        import common.m6
match 3:
    case 3 if 4:
        import common.m7
try:
    pass
except* OSError:
    import common.m8
"""
    (tmp_path / "common" / "a.py").write_text(text)
    monkeypatch.setattr(lab.trials.provenance, "ROOT", tmp_path)
    assert set(closure("common.a")) == {"common.a", *(f"common.{name}" for name in names)}


def test_no_clone_no_revision(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab.trials.provenance, "ROOT", tmp_path)
    assert revision.__wrapped__() == ""
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    (tmp_path / "inside").mkdir()
    monkeypatch.setattr(lab.trials.provenance, "ROOT", tmp_path / "inside")
    # Installed below somebody else's clone.
    assert revision.__wrapped__() == ""


def test_the_record_of_a_run_names_python_machine_and_packages() -> None:
    record = environment()
    assert record["python"] == platform.python_version()
    assert int(record["cpus"]) >= 1
    assert record["numpy"] == np.__version__
    assert record.get("commit", "") == revision()


def test_the_kind_of_processor_is_named_with_the_kernels_that_work() -> None:
    assert machine().startswith(platform.machine())
    assert environment()["machine"] == machine()
    if "unknown" in machine():
        pytest.skip("this NumPy has no OpenBLAS of its own")
    code = "from lab.trials.provenance import machine; print(machine())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"OPENBLAS_CORETYPE": "Prescott"},
        capture_output=True,
        text=True,
        check=True,
    )
    # Only on this kind of processor does OpenBLAS know those kernels.
    assert (done.stdout.strip() == machine()) == (platform.machine() != "x86_64")


def test_the_machine_tells_whether_compiled_kernels_are_in_use() -> None:
    code = "from lab.trials.provenance import machine; print(machine())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"TRILL_NATIVE": "0"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.endswith("; no compiled kernels (TRILL_NATIVE=0)\n")
