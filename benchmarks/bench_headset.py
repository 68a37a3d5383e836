"""Measure the operator in a browser: from a pose to the bus, from the bus to a page, and its cost.

The operator runs as a process of its own with its web server. This process plays the robot (state,
authority, target, stereo pictures of 2 x 12 kB at 20 Hz) and the pages: a headset that sends poses
at 72 Hz with the clutch held, and watchers. Every pose is told apart by its height, so that the
time from sending it to the set-point on the bus that holds it is measured one by one; both clocks
are the machine's monotonic one.

    python benchmarks/bench_headset.py [--seconds N] [--watchers N]
"""

import argparse
import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np

from common.runtime.live.config import RuntimeConfig
from common.runtime.live.runner import LiveRunner
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    CameraFrame,
    ControllerState,
    ControlState,
    Gait,
    Header,
    OperatorKind,
    Setpoint,
)
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    TELEOP_CLAIM,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_STATE,
    WBC_TARGET,
)
from common.transport.config import BusConfig
from deploy.ports import reserve_base_port
from services.teleop.targets.targets import OperatorTargets

RATE = 72.0
"""Of the headset's poses [Hz]."""
STEP = 1e-4
"""Height from one pose to the next [m]."""
POSES = 1500
"""Poses that can be told apart."""
PICTURE = bytes(12_000)
START_TIMEOUT = 60.0


class Robot(Service):
    """Gives the robot to whoever wants it, shows pictures and notes the set-points.

    Attributes:
        setpoints: height of the right hand [m], and when it was sent [ns].
        pictures: when a picture was captured, by its robot time [ns].
    """

    name = "wbc"
    period_ns = 10_000_000
    reads = (TELEOP_CLAIM, TELEOP_SETPOINT)
    writes = (WBC_STATE, WBC_AUTHORITY, WBC_TARGET, CAMERA_LEFT, CAMERA_RIGHT)

    def __init__(self) -> None:
        self.setpoints: list[tuple[float, int]] = []
        self._target: Setpoint = OperatorTargets().setpoint(0)
        self._steps = 0

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Publish what is due."""
        self._steps += 1
        header = Header(stamp=now_ns)
        for setpoint in inputs.history(TELEOP_SETPOINT, 0.5):
            sent = setpoint.header.sent
            if not self.setpoints or sent > self.setpoints[-1][1]:
                self.setpoints.append((float(setpoint.right_hand_position_in_body[2]), sent))
        outputs = [Output(WBC_STATE, _state(header))]
        if self._steps % 10 == 0:
            outputs.append(Output(WBC_AUTHORITY, self._authority(inputs, header)))
        if self._steps % 5 == 0:
            target = self._target.model_copy(update={"header": header})
            outputs += [
                Output(WBC_TARGET, target),
                Output(CAMERA_LEFT, _picture("left", header)),
                Output(CAMERA_RIGHT, _picture("right", header)),
            ]
        return outputs

    def _authority(self, inputs: Inputs, header: Header) -> AuthorityState:
        claim = inputs.latest(TELEOP_CLAIM)
        holds = claim is not None and claim.wants
        return AuthorityState(
            header=header,
            holder=claim.header.source if claim and holds else "",
            holder_boot=claim.header.boot if claim and holds else 0,
            kind=OperatorKind.PERSON,
            changes=1 + holds,
            change=AuthorityChange.GRANTED if holds else AuthorityChange.RELEASED,
            previous="",
            previous_boot=0,
            since=0,
        )


def _state(header: Header) -> ControllerState:
    return ControllerState(
        header=header,
        state=ControlState.BALANCE,
        gait=Gait.NONE,
        gait_progress=0.0,
        gaits_completed=0,
        dcm_error=0.0,
        com_in_world=np.zeros(3),
        hand_position_error=np.zeros(2),
        hand_rotation_error=np.zeros(2),
        hand_weight=1.0,
        setpoint_fresh=True,
        solver="none",
        unsolved=0,
    )


def _picture(eye: Any, header: Header) -> CameraFrame:
    return CameraFrame(header=header, eye=eye, width=400, height=300, encoding="jpeg", data=PICTURE)


@contextmanager
def running(folder: Path) -> Iterator[tuple[Robot, str, int]]:
    """Run robot and operator; yield the robot, the link to the page, the operator's process id."""
    settings = folder / "settings.toml"
    settings.write_text(f'[headset]\nport = 0\npages = 100\nfolder = "{folder}"\n')
    with reserve_base_port() as base_port:
        robot = Robot()
        runner = LiveRunner(
            robot, BusConfig(base_port=base_port), runtime=RuntimeConfig(rt_priority=0)
        )
        thread = threading.Thread(target=runner.run)
        thread.start()
        command = [sys.executable, "-m", "services.teleop", "headset", "--config", str(settings)]
        operator = subprocess.Popen(
            [*command, "--base-port", str(base_port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            line = operator.stdout.readline() if operator.stdout else ""
            found = re.search(r"http\S+", line)
            if found is None:
                raise SystemExit(f"the operator did not start: {line}")
            yield robot, found[0], operator.pid
        finally:
            operator.terminate()
            operator.wait()
            runner.stop()
            thread.join()


def sample(number: int, squeeze: float) -> str:
    """Return the pose ``number`` of the headset."""
    held = {"quaternion": [1, 0, 0, 0], "tracked": True}
    right = {"position": [0.2, 1.0 + STEP * (number % POSES), -0.4], "squeeze": squeeze, **held}
    return json.dumps(
        {
            "type": "sample",
            "t": 1e3 * time.monotonic(),
            "head": {"position": [0, 1.6, 0], **held},
            "left": {"position": [-0.2, 1.0, -0.4], **held},
            "right": right,
        }
    )


async def wear(socket: Any, seconds: float) -> list[int]:
    """Send poses; return when each was sent [ns]."""
    for number in range(round(0.5 * RATE)):
        await socket.send_str(sample(0, float(number > 5)))
        await asyncio.sleep(1.0 / RATE)
    sent = []
    began = time.monotonic()
    for number in range(round(seconds * RATE)):
        await asyncio.sleep(max(0.0, began + number / RATE - time.monotonic()))
        sent.append(time.monotonic_ns())
        await socket.send_str(sample(number, 1.0))
    return sent


async def watch(socket: Any, ages: list[float]) -> None:
    """Take in pictures; note how old each is when it comes [s]."""
    async for message in socket:
        if message.type is not aiohttp.WSMsgType.BINARY:
            continue
        length = int.from_bytes(message.data[:4], "little")
        header = json.loads(message.data[4 : 4 + length])
        ages.append(1e-9 * (time.monotonic_ns() - header["stamp"]))
        shown = {"type": "shown", "t": 1e3 * time.monotonic(), "picture": header["number"]}
        await socket.send_str(json.dumps(shown))


async def measure(
    url: str, pid: int, seconds: float, watchers: int
) -> tuple[list[int], list[float], float]:
    """Wear a headset while others watch.

    Returns:
        when each pose was sent [ns], how old each picture was when it came to a page [s], share of
        a core that the operator's process took.
    """
    page, _, token = url.partition("#")
    headers = {"Origin": page.rstrip("/")}
    ages: list[float] = []
    async with aiohttp.ClientSession(headers=headers) as session:

        async def enter() -> Any:
            return await session.ws_connect(f"{page}socket", params={"token": token})

        tasks = [asyncio.ensure_future(watch(await enter(), ages)) for _ in range(watchers)]
        socket = await enter()
        tasks.append(asyncio.ensure_future(watch(socket, ages)))
        before, began = _cpu(pid), time.monotonic()
        sent = await wear(socket, seconds)
        share = (_cpu(pid) - before) / (time.monotonic() - began)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return sent, ages, share


def _cpu(pid: int) -> float:
    """Return the processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pose_times(robot: Robot, sent: Sequence[int]) -> list[float]:
    """Return the time from each pose that became a set-point to that set-point's sending [s]."""
    base = robot.setpoints[0][0]
    found = []
    for height, at in robot.setpoints:
        number = round((height - base) / STEP)
        candidates = [when for when in sent[number % POSES :: POSES] if when <= at]
        if candidates and number > 0:
            found.append(1e-9 * (at - candidates[-1]))
    return found


def show(what: str, times: Sequence[float]) -> None:
    """Print median, 99th percentile and worst of ``times`` [s]."""
    median, p99 = np.percentile(np.array(times) * 1e3, (50.0, 99.0))
    print(
        f"{what}: median {median:.1f} ms, p99 {p99:.1f} ms, worst {1e3 * max(times):.1f} ms "
        f"({len(times)})"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement (20)")
    parser.add_argument("--watchers", type=int, default=9, help="pages besides the headset (9)")
    arguments = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for watchers in dict.fromkeys((0, arguments.watchers)):
        with tempfile.TemporaryDirectory() as name, running(Path(name)) as (robot, url, pid):
            sent, ages, share = asyncio.run(measure(url, pid, arguments.seconds, watchers))
        print(f"{1 + watchers} pages; the operator's process takes {share:.0%} of a core")
        show("  from a pose to the set-point on the bus", pose_times(robot, sent))
        show("  from the capture of a picture to a page", ages)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
