"""What recording costs: the recorder against a bare MCAP writer, and its share of a processor.

Both write the same bytes of the same messages, in the proportions in which a robot sends them
(state 200, command 100, controller 100, truth 50, two cameras 20 each), to files of their own; in
blocks, one after the other, so that whatever else the machine does meets both alike. The recorder
queues, reads the header, counts deliveries and writes; the bare writer only writes. Both close a
chunk as often as it is due at full rate. Times are of the processor, so that they are not those of
what else runs.

Then a recorder runs as a process of its own beside a synthetic robot, and its processor time is
taken from the system.

    python benchmarks/bench_logger.py [--seconds 60] [--live 20]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer

from common.schemas import Header, Message
from common.topics import EPISODE
from common.transport.tap import RawSample
from common.wire.codec import encode, schema_tag
from deploy.ports import reserve_base_port
from services.logger.log_format import COMPRESSION
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from verification.faults.support import probes
from verification.faults.support.messages import ROBOT_RATES, message_streams

BLOCK_S = 0.25
"""Length of a block in robot time, and of a chunk [s]."""

Block = list[RawSample]
Write = Callable[[Block], tuple[list[int], int]]


def blocks(pictures: str, seconds: float) -> Iterator[Block]:
    """What a robot sends, block by block, with headers of their own."""
    streams = message_streams(pictures)
    counts = dict.fromkeys(streams, 0)
    start = time.monotonic_ns()
    for number in range(round(seconds / BLOCK_S)):
        block = []
        for topic, rate in ROBOT_RATES.items():
            if topic is EPISODE or topic not in streams:
                continue
            schema: type[Message] = topic.schema
            tag = schema_tag(schema)
            for place in range(round(rate * BLOCK_S)):
                at = start + round(1e9 * (number * BLOCK_S + place / rate))
                header = Header(seq=counts[topic], stamp=at, sent=at, boot=1, source="bench")
                counts[topic] += 1
                payload = encode(next(streams[topic]), header)
                block.append(RawSample(f"draco3/{topic.name}", payload, tag, at))
        block.sort(key=lambda sample: sample.arrival_ns)
        yield block


def recorder_writes(path: Path, config: LoggerConfig) -> tuple[Write, Callable[[], object]]:
    """Return a function that records a block as the recorder does, and one that closes the file."""
    sink = McapSink(path, "draco3", config)
    recorder = Recorder(sink, config)

    def write(block: Block) -> tuple[list[int], int]:
        times = []
        begin = time.thread_time_ns()
        for sample in block:
            start = time.thread_time_ns()
            recorder.intake.offer(sample)
            for taken in recorder.intake.take():
                recorder._record(taken)
            times.append(time.thread_time_ns() - start)
        sink.flush()
        return times, time.thread_time_ns() - begin

    return write, lambda: sink.close(sync=False)


def bare_writes(path: Path, config: LoggerConfig) -> tuple[Write, Callable[[], object]]:
    """Write a block with nothing but the library."""
    stream = path.open("xb")
    compression = COMPRESSION[config.compression]
    writer = Writer(stream, chunk_size=config.chunk_size, compression=compression)
    writer.start()
    channels: dict[str, int] = {}

    def write(block: Block) -> tuple[list[int], int]:
        times = []
        begin = time.thread_time_ns()
        for number, sample in enumerate(block):
            start = time.thread_time_ns()
            channel = channels.get(sample.key)
            if channel is None:
                channel = channels[sample.key] = writer.register_channel(sample.key, "msgpack", 0)
            writer.add_message(channel, sample.arrival_ns, sample.payload, start, number)
            times.append(time.thread_time_ns() - start)
        writer.flush()
        return times, time.thread_time_ns() - begin

    def close() -> None:
        writer.finish()
        stream.close()

    return write, close


def compare(pictures: str, seconds: float) -> dict[str, dict[str, float]]:
    """Write ``seconds`` of robot time both ways, block by block in turn."""
    config = LoggerConfig()
    with tempfile.TemporaryDirectory() as place:
        ways = {
            "recorder": recorder_writes(Path(place) / "recorder.mcap", config),
            "bare writer": bare_writes(Path(place) / "bare.mcap", config),
        }
        times: dict[str, list[int]] = {name: [] for name in ways}
        spans = dict.fromkeys(ways, 0)
        size = 0
        for number, block in enumerate(blocks(pictures, seconds)):
            size += sum(len(sample.payload) for sample in block)
            for name in list(ways)[:: 1 if number % 2 else -1]:
                each, span = ways[name][0](block)
                times[name] += each
                spans[name] += span
        for _, close in ways.values():
            close()
    return {
        name: {
            "median_us": 1e-3 * float(np.median(each)),
            "p99_us": 1e-3 * float(np.percentile(each, 99)),
            "messages_per_s": len(each) / (1e-9 * spans[name]),
            "mb_per_s": 1e-6 * size / (1e-9 * spans[name]),
        }
        for name, each in times.items()
    }


def live_share(pictures: str, seconds: float) -> dict[str, float]:
    """Share of one processor that a recorder takes beside a robot at full rate."""
    with tempfile.TemporaryDirectory() as place, reserve_base_port() as port:
        out, journal = Path(place) / "out", Path(place) / "journal"
        bus = ["--base-port", str(port)]
        options = ["--role", "source", "--pictures", pictures, "--journal", str(journal)]
        load = _start(probes.MODULE, *bus, *options)
        recorder = _start("services.logger", *bus, "--out", str(out))
        try:
            log = out / "log.mcap"
            while not (log.exists() and log.stat().st_size > 20_000):
                if recorder.poll() is not None or load.poll() is not None:
                    raise SystemExit("bench: the recorder or the synthetic robot did not start")
                time.sleep(0.05)
            began, used, size = time.monotonic(), _cpu_s(recorder.pid), log.stat().st_size
            time.sleep(seconds)
            wall = time.monotonic() - began
            share = (_cpu_s(recorder.pid) - used) / wall
            return {"cpu": share, "file_mb_per_s": 1e-6 * (log.stat().st_size - size) / wall}
        finally:
            for process in (recorder, load):
                process.terminate()
                process.wait(30)


def _start(module: str, *words: str) -> "subprocess.Popen[bytes]":
    silent: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-m", module, *words], **silent)


def _cpu_s(pid: int) -> float:
    """Processor time of a process and its threads so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n\n")[0],
        epilog="Numbers of a busy machine are those of a busy machine.",
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of robot time to write (60)")
    parser.add_argument("--live", type=float, default=20.0, help="of recording live (20) [s]")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    print(f"{'':<22} {'median':>9} {'p99':>9} {'messages/s':>11} {'MB/s':>7}")
    for pictures in ("jpeg", "raw"):
        results[pictures] = compare(pictures, arguments.seconds if pictures == "jpeg" else 15.0)
        for name, row in results[pictures].items():
            label = f"{name}, {pictures}"
            print(
                f"{label:<22} {row['median_us']:>6.1f} µs {row['p99_us']:>6.0f} µs "
                f"{row['messages_per_s']:>11.0f} {row['mb_per_s']:>7.1f}",
                flush=True,
            )
    for pictures in ("jpeg", "raw"):
        live = results[f"live {pictures}"] = live_share(pictures, arguments.live)
        print(
            f"live, {pictures:<16} {100 * live['cpu']:.1f} % of one processor, "
            f"file {live['file_mb_per_s']:.2f} MB/s",
            flush=True,
        )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
