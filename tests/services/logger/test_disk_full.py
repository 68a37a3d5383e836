"""A disk that fills up ends the recording with a reason, and nothing else."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from common.schemas import CameraFrame
from common.topics import CAMERA_LEFT
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from deploy.ports import reserve_base_port
from services.logger.read.delivery import total
from services.logger.read.reader import LogReader
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of

ROOM = 1_000_000


@pytest.fixture
def feed() -> Iterator[tuple[int, Any, Callable[[], float]]]:
    """A base port, a publisher of incompressible pictures, and what sends one and times it."""
    with reserve_base_port() as port:
        session: Any = open_session(BusConfig(base_port=port), "sim")
        publisher = Publisher(session, "draco3", CAMERA_LEFT, "cameras", 5)

        def send() -> float:
            frame = CameraFrame(
                eye="left", width=4, height=4, encoding="jpeg", data=os.urandom(20_000)
            )
            start = time.monotonic()
            assert publisher.send(frame)
            return time.monotonic() - start

        yield port, publisher, send
        session.close()


def record_until_full(
    out: Path,
    port: int,
    send: Callable[[], float],
    limit: Callable[[], None] | None = None,
    min_free: str = "0",
    period: float = 0.01,
) -> tuple[int, str]:
    where = ["--out", str(out), "--base-port", str(port)]
    process = subprocess.Popen(
        [sys.executable, "-m", "services.logger", *where, "--min-free", min_free],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=limit,  # noqa: PLW1509 - no threads of this process hold locks it needs
    )
    try:
        deadline = time.monotonic() + 60.0
        while process.poll() is None:
            assert time.monotonic() < deadline, "the recorder did not notice"
            send()
            time.sleep(period)
        return process.returncode, process.communicate()[0]
    finally:
        process.kill()
        process.wait()


def check(log: Path, code: int, printed: str, publisher: Any, send: Callable[[], float]) -> None:
    assert code == 1
    assert "cannot write the log" in printed
    assert "free some space" in printed
    assert "Traceback" not in printed
    # The robot goes on.
    before = publisher.sent
    for _ in range(20):
        send()
    assert (publisher.sent, publisher.errors) == (before + 20, 0)
    reader = LogReader(log)
    readable = [entry.payload for entry in reader.raw_messages()]
    assert reader.truncated
    assert len(readable) > 0.4 * ROOM / 20_000
    saved = log.parent.parent / "saved.mcap"
    done = repair(log, saved)
    assert fault_of(saved) == ""
    assert done.messages >= len(readable)
    assert total(done.report).lost == 0
    assert [entry.payload for entry in LogReader(saved).raw_messages()][: len(readable)] == readable


def test_a_limit_on_the_file(tmp_path: Path, feed: Any) -> None:
    port, publisher, send = feed

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))

    out = tmp_path / "out"
    code, printed = record_until_full(out, port, send, limit)
    assert "File too large" in printed
    check(out / "log.mcap", code, printed, publisher, send)


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_full_disk(tmp_path: Path, tiny_disk: Path, feed: Any) -> None:
    port, publisher, send = feed
    code, printed = record_until_full(tiny_disk, port, send)
    assert "No space left on device" in printed
    assert "nearly full" in printed
    check(tiny_disk / "log.mcap", code, printed, publisher, send)
    # There is no room to repair it in place; it stays what it is.
    before = (tiny_disk / "log.mcap").read_bytes()
    with pytest.raises(Exception, match=r"No space left on device; free some space"):
        repair(tiny_disk / "log.mcap")
    assert (tiny_disk / "log.mcap").read_bytes() == before
    assert [one.name for one in tiny_disk.iterdir()] == ["log.mcap"]


def test_a_nearly_full_disk_ends_the_recording_whole(
    tmp_path: Path, tiny_disk: Path, feed: Any
) -> None:
    port, _, send = feed
    code, printed = record_until_full(tiny_disk, port, send, min_free="500kB", period=0.05)
    assert code == 1
    assert "min_free" in printed
    log = tiny_disk / "log.mcap"
    assert fault_of(log) == ""
    assert sum(1 for _ in LogReader(log).raw_messages()) > 5
    # Another one does not even begin, and leaves nothing behind.
    out = tiny_disk / "next"
    code, printed = record_until_full(out, port, send, min_free="500kB")
    assert code == 1
    assert "min_free" in printed
    assert not out.exists()
