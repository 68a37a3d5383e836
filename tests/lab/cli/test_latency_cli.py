"""``trill latency`` and ``--latency``: what a person types, what is refused, what is answered."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

from common.links.client import read_links
from common.transport.config import BusConfig
from common.transport.session import open_session
from lab.cli.main import main
from tests.common.transport.support import free_base_port

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("command", ["up", "demo", "drive"])
@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("comand=250ms", r"no topic 'comand'; expected .* command, camera, feedback, both"),
        ("command=soon", "'soon' is not a duration"),
        ("missing.toml", "missing.toml"),
        ("250ms", "expected 'command=250ms'"),
        ("empty.toml", r"expected a table \[links\]"),
        ("trace.toml", r"trace\(delays.csv\)"),
        ("camera=1ms;2ms", "'1ms;2ms' is not a duration"),
    ],
)
def test_wrong_latency_starts_nothing(
    command: str,
    option: str,
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.toml").write_text("[bus]\n")
    (tmp_path / "trace.toml").write_text("[links.command]\ndistribution = 'trace'\ntrace = [0.1]\n")
    assert main([command, "--latency", option]) == 2
    said = capsys.readouterr().err
    assert re.search(text, said)
    assert not (tmp_path / "runs").exists()


def test_explain_tells_warns_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "delays.png"
    words = ["latency", "explain", "normal(122ms, 190ms)", "loss=1%", "--rate", "20"]
    assert main([*words, "--plot", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "requested │ 122.0 │ 190.0 │ 122.0 │ 564.0" in said
    assert "held back to keep order, 26 % drawn below 0, 1 % lost" in said
    assert "warning: at 20 Hz the mean will be" in said
    image = cv2.imread(str(path))
    assert image is not None
    assert image.std() > 5.0
    assert main(["latency", "explain", "250ms", "--plot", str(tmp_path / "no" / "x.png")]) == 1
    assert "warning" not in capsys.readouterr().out
    assert main(["latency", "explain", "wide(1ms)"]) == 2
    assert main(["latency", "explain", "1ms", "--rate", "-2"]) == 2


def test_help_teaches_names_and_specifications(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["latency"], ["latency", "set"]):
        with pytest.raises(SystemExit) as ended:
            main([*words, "--help"])
        assert ended.value.code == 0
        text = capsys.readouterr().out
        for part in ("feedback", "paper", "emergency stop", "guard holds", "order=free", "loss=1%"):
            assert part in text
    with pytest.raises(SystemExit) as ended:
        main(["latency"])
    assert ended.value.code == 2


def test_nobody_there_exits_with_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["latency", "show", "--base-port", str(free_base_port(20))]) == 1
    assert "no service of 'draco3' answered" in capsys.readouterr().err


@pytest.fixture
def toy() -> Iterator[int]:
    """A toy controller alone on its bus; the base port."""
    base = free_base_port(20)
    clean = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
    command = [sys.executable, "-m", "tests.common.runtime.toys", "--kind", "controller"]
    command += ["--base-port", str(base), "--rt-priority", "0"]
    process = subprocess.Popen(
        command,
        env=clean | {"TOY_NAME": "wbc", "PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    session: Any = open_session(BusConfig(base_port=base), "waiting")
    try:
        read_links(session, "draco3", patience_s=60.0)
    finally:
        session.close()
    yield base
    process.send_signal(signal.SIGTERM)
    give_up = time.monotonic() + 20.0
    while process.poll() is None and time.monotonic() < give_up:
        time.sleep(0.05)
    process.kill()
    process.communicate()
    assert process.returncode == 0


def test_set_show_and_clear_a_running_service(toy: int, capsys: pytest.CaptureFixture[str]) -> None:
    def trill(*words: str) -> tuple[int, str]:
        code = main(["latency", *words, "--base-port", str(toy)])
        out, err = capsys.readouterr()
        return code, " ".join((out + err).split())

    code, said = trill("set", "command", "250ms", "loss=1%")
    assert code == 0
    assert "wbc: teleop/gait: 250ms loss=1% (was none)" in said
    assert "│ wbc │ teleop/gait │ 250ms loss=1% │ 250.0 │ 250.0 │ │ │ 0 │ 0 │ 0 │" in said
    assert "│ wbc │ plant/state │ - │" in said
    code, said = trill("set", "camera", "5ms")
    assert code == 1
    assert "reads camera: nothing is changed. Running: wbc" in said
    # In as a client of the service itself, as through a router.
    code, said = trill("show", "--connect", f"tcp/127.0.0.1:{toy + 1}")
    assert (code, "250ms loss=1%" in said) == (0, True)
    code, said = trill("clear", "teleop/gait")
    assert "wbc: teleop/gait: no delay (was 250ms loss=1%)" in said
    assert code == 0
    assert trill("set", "wbc:plant/state", "5ms")[0] == 0
    code, said = trill("clear")
    assert "wbc: plant/state: no delay (was 5ms)" in said
    assert "teleop/gait: no delay" not in said
    assert code == 0
