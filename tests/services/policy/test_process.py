"""The commands: what cannot be served is refused in words, before the bus is opened."""

import json
import pickle
import shutil
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("safetensors")

from common.transport.config import read_config_file
from services.policy.checkpoint.manifest import NETWORK
from services.policy.command import build, main
from services.policy.server import main as serve
from services.policy.serving.remote import RemoteEngine
from tests.services.policy.test_checkpoint import edit, replace, written

Damage = Callable[[Path], object]

DAMAGES: dict[str, tuple[Damage, str]] = {
    "no such folder": (shutil.rmtree, "cannot read config.json"),
    "cut short": (
        lambda folder: (folder / NETWORK).write_bytes((folder / NETWORK).read_bytes()[:-9]),
        "damaged, cut short or of another checkpoint",
    ),
    "a pickle": (
        lambda folder: replace(folder, NETWORK, pickle.dumps({"weights": [1.0]})),
        "is a pickle, which could run any code; it is not read",
    ),
    "another schema": (
        lambda folder: edit(folder, lambda given: given["interface"].update(rate=10)),
        "rate: expected 20, got 10",
    ),
    "another version": (
        lambda folder: edit(folder, lambda given: given.update(schema_version=9)),
        "expected version 1 of the manifest",
    ),
}


@pytest.mark.parametrize("run", [main, serve], ids=["policy", "server"])
@pytest.mark.parametrize(("damage", "said"), DAMAGES.values(), ids=list(DAMAGES))
def test_what_cannot_be_served_is_refused_in_words(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    run: Callable[[list[str]], int],
    damage: Damage,
    said: str,
) -> None:
    folder = written(tmp_path)
    damage(folder)
    assert run([str(folder)]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_wrong_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = written(tmp_path)
    assert main([]) == 2
    assert "checkpoint: not given" in capsys.readouterr().err
    assert main([str(folder), "--execute", "0"]) == 2
    assert "execute" in capsys.readouterr().err
    assert main([str(folder), "--kind", "bc"]) == 1
    assert "expected a policy of kind bc" in capsys.readouterr().err
    assert main([str(folder), "--device", "abacus"]) == 1
    assert "cannot run a policy on device 'abacus'" in capsys.readouterr().err


def test_the_robots_side_of_a_remote_policy_does_without_the_network(tmp_path: Path) -> None:
    folder = written(tmp_path)
    (folder / NETWORK).unlink()
    config = tmp_path / "robot.toml"
    config.write_text(f"[policy]\ncheckpoint = {json.dumps(str(folder))}\nremote = true\n")
    table = read_config_file(config)["policy"]
    operator = build(Namespace(settings=table))
    assert isinstance(operator.engine, RemoteEngine)
    assert operator.cameras == ("left", "right")
