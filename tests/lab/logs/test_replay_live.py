"""What services did live, over Zenoh and on the wall clock, is replayed to the byte."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lab.cli.main import main
from lab.logs.replay_check import runs_in
from tests.common.transport.support import free_base_port

ROOT = Path(__file__).parents[3]
SCRIPT = {
    "name": "walk and wave",
    "steps": [
        {"do": "move", "left": {"position": [0.36, 0.24, 0.1]}, "duration": 0.5},
        {
            "do": "together",
            "lanes": [
                [{"do": "gait", "gait": "forward", "count": 1}],
                [{"do": "sine", "hand": "right", "axis": "z", "amplitude": 0.05, "duration": 3}],
            ],
        },
        {"do": "wait", "seconds": 60},
    ],
}


@contextmanager
def running(folder: Path, port: int, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A service as a process, its output in a file; killed at the end if it is still there."""
    name = words[0].rpartition(".")[2]
    with (folder / f"{name}.txt").open("ab") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT), "TRILL_BASE_PORT": str(port)},
            stdout=output,
            stderr=output,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_for(condition: Callable[[], bool], what: str, seconds: float = 180.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what} did not come about in {seconds:g} s"
        time.sleep(0.05)


def stop(process: "subprocess.Popen[bytes]", expected: tuple[int, ...] = (0,)) -> None:
    process.send_signal(signal.SIGINT)
    assert process.wait(60) in expected


def test_live_services_are_replayed_to_the_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "script.json").write_text(json.dumps(SCRIPT))
    port = free_base_port(16)
    wbc = ("services.wbc", "--link", "plant/state=normal(3ms, 2ms) loss=2%")

    def printed(name: str, text: str) -> int:
        return (tmp_path / f"{name}.txt").read_text().count(text)

    with (
        running(tmp_path, port, "services.logger", "--out", "log") as logger,
        running(tmp_path, port, "services.sim", "--noise", "typical") as sim,
        running(tmp_path, port, "services.teleop", "scripted", "--script", "script.json") as teleop,
    ):
        with running(tmp_path, port, *wbc) as first:
            wait_for(lambda: printed("wbc", "is on the bus") == 1, "the first run")
            # Enough to stand up and begin a gait, unless the machine is overloaded.
            time.sleep(8.0)
            assert first.poll() is None, (tmp_path / "wbc.txt").read_text()
            first.kill()
        # What becomes of the robot is for others to test; an overloaded machine may let it fall.
        with running(tmp_path, port, *wbc) as second:
            wait_for(lambda: printed("wbc", "is on the bus") == 2, "the second run")
            time.sleep(3.0)
            # The operator gives up, code 1, if the second run takes long to begin.
            stop(teleop, expected=(0, 1))
            stop(second)
            stop(sim)
        stop(logger)

    log = tmp_path / "log" / "log.mcap"
    runs = {(run.service, run.number): run for run in runs_in(log)}
    assert set(runs) == {("sim", 1), ("teleop", 1), ("wbc", 1), ("wbc", 2)}
    assert not any(run.obstacle or run.ends for run in runs.values())
    # After a run's first seconds its journal only names its inputs: the log has the bytes.
    assert sum(map(len, runs["wbc", 1].needed.values())) > 100
    assert runs["wbc", 1].length > 200
    assert runs["wbc", 2].length > 50
    code = main(["replay", str(log), "--service", "wbc", "--service", "teleop"])
    # The plant may have waited long for the others to start.
    code += main(["replay", str(log), "--service", "sim", "--until", "15"])
    report = capsys.readouterr().out
    assert code == 0, report
    assert report.count("IDENTICAL to the byte") == 4
    for topic in ("wbc/command ", "wbc/state ", "teleop/setpoint ", "plant/state ", "plant/truth "):
        assert topic in report
    assert main(["replay", str(log), "--service", "wbc", "--set", "tasks.torso.kp=101"]) == 1
