"""Make a long log by repeating a short one: ``python -m benchmarks.long_log OUT --minutes 60``.

The short one is a minute of a robot that walks by a script in simulated time, with small pictures,
heartbeats, health, episode marks and journals. A repetition either continues it, as one run of each
service: sequence numbers, times, steps and the numbers of gait requests go on, so that no message
is missing. Or, with ``--restarts``, every service is started anew: only boot ids differ, so that
each run can be replayed to the byte.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgpack
import numpy as np

from common.journal.tables import INPUT_COLUMNS, STEP_COLUMNS, read_tables
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    CameraFrame,
    EpisodeAction,
    EpisodeMark,
    Header,
    Heartbeat,
    Message,
    ServiceHealth,
    StepJournal,
)
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    EPISODE,
    HEALTH,
    HEARTBEAT,
    JOURNAL,
    TELEOP_GAIT,
    WBC_REPLY,
    Topic,
)
from common.transport.keys import topic_of
from common.transport.tap import RawSample
from common.wire.codec import decode, encode
from lab.progress import ProgressBar
from services.logger.log_format import DELIVERY_METADATA
from services.logger.read.delivery import DeliveryStats
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.scripted.library import ScriptOptions, random_walk
from services.teleop.scripted.service import ScriptedOperator
from services.wbc.service import WbcService

ROBOT = "draco3"
MINUTE_NS = 60_000_000_000
_PERIOD_S = 0.01
_FLUSH_NS = 250_000_000
"""Between the ends of two chunks, as a recorder ends them [ns]."""
_GAITS = 100
"""More than a robot walks in a minute."""
_NUMBERED = {TELEOP_GAIT: "request_id", WBC_REPLY: "request_id"}
_TIMES = [INPUT_COLUMNS.index(name) for name in ("captured", "sent", "arrival")]
_SOURCE, _SEQ, _SIZE = (INPUT_COLUMNS.index(name) for name in ("source", "seq", "size"))

Repeat = Callable[[int], bytes]
"""Returns the bytes of a message in a repetition, numbered from 0."""


def record_minute() -> list[RawSample]:
    """Return the messages of a minute in the order of sending."""
    operator = ScriptedOperator(random_walk(ScriptOptions(count=_GAITS)))
    services = [PlantService(SimConfig()), WbcService(), operator]
    with SimTimeRunner(services, robot=ROBOT, record=True) as runner:
        for tick in range(round(1e-9 * MINUTE_NS / _PERIOD_S)):
            for topic, message, source in _surroundings(tick, [one.name for one in services]):
                runner.inject(topic, message, source)
            runner.run_for(_PERIOD_S)
        # The journals of the last steps come a little later.
        runner.run_for(0.5)
        return [sample for sample in runner.log if _is_of_minute(sample)]


def _is_of_minute(sample: RawSample) -> bool:
    if sample.arrival_ns < MINUTE_NS:
        return True
    if topic_of(ROBOT, sample.key) is not JOURNAL:
        return False
    steps, _ = read_tables(decode(sample.payload, StepJournal))
    return bool(steps[0, 0] < MINUTE_NS)


def _surroundings(tick: int, services: Iterable[str]) -> Iterator[tuple[Topic[Any], Message, str]]:
    """Yield what those services send that simulated time does without."""
    if tick in {100, 5900}:
        action = EpisodeAction.START if tick == 100 else EpisodeAction.END
        yield EPISODE, EpisodeMark(episode=0, action=action, label="walk"), "mark"
    if tick % 5 == 0:
        for topic, eye in ((CAMERA_LEFT, "left"), (CAMERA_RIGHT, "right")):
            yield topic, _picture(eye, tick), "cameras"
    for service in services:
        if tick % 4 == 0:
            yield HEARTBEAT, Heartbeat(steps=tick, timeout=0.5), service
        if tick % 50 == 0:
            figures = {"period": 0.01, "deadline_misses": 0, "cpu": 0.2, "links": []}
            spread = {"step_median": 1e-3, "step_p99": 2e-3, "realtime": "normal"}
            about = {"service": service, "pid": 1, "steps": tick, **figures, **spread}
            yield HEALTH, ServiceHealth.model_validate(about), service


def _picture(eye: str, tick: int) -> CameraFrame:
    """Return a JPEG of a gradient that moves with ``tick``."""
    image = np.tile(np.arange(64, dtype=np.uint8) + tick % 128, (48, 1))
    data = cv2.imencode(".jpg", image)[1].tobytes()
    fields = {"eye": eye, "width": 64, "height": 48, "encoding": "jpeg", "data": data}
    return CameraFrame.model_validate(fields)


@dataclass(frozen=True)
class _Counts:
    """What a minute holds: messages by (topic, sender), steps by service."""

    messages: Counter[tuple[str, str, int]]
    steps: Counter[str]


def _split(payload: bytes) -> tuple[bytes, dict[str, Any], bytes]:
    """Return a message's bytes before its header, the header, and the bytes behind it."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(payload)
    unpacker.read_map_header()
    unpacker.unpack()
    start = unpacker.tell()
    header = unpacker.unpack()
    return payload[:start], header, payload[unpacker.tell() :]


def _continued(sample: RawSample, counts: _Counts) -> Repeat:
    """Return how a message is repeated as one run goes on."""
    start, header, rest = _split(sample.payload)
    topic = topic_of(ROBOT, sample.key)
    assert topic is not None
    sent = counts.messages[topic.name, header["source"], header["boot"]]
    first, times = header["seq"], {n: header[n] for n in ("stamp", "captured", "sent")}
    if topic is JOURNAL:
        times["sent"] = min(times["sent"], MINUTE_NS - 1)

    def header_of(number: int) -> dict[str, Any]:
        shifted = {name: at + number * MINUTE_NS for name, at in times.items()}
        return {**header, **shifted, "seq": first + number * sent}

    if topic is JOURNAL:
        journal = _without_payloads(decode(sample.payload, StepJournal))
        return lambda number: encode(
            _continued_journal(journal, counts, number), Header(**header_of(number))
        )
    counter = {**_NUMBERED, EPISODE: "episode"}.get(topic)
    if counter is not None:
        # Numbers of gait requests are times in milliseconds.
        step = 1 if topic is EPISODE else MINUTE_NS // 1_000_000
        message: Message = decode(sample.payload, topic.schema)
        value = getattr(message, counter)
        return lambda number: encode(
            message.model_copy(update={counter: value + number * step}),
            Header(**header_of(number)),
        )
    return lambda number: b"".join((start, msgpack.packb(header_of(number)), rest))


def _without_payloads(journal: StepJournal) -> StepJournal:
    """Return a journal up to the minute's end, of messages that are all in the log themselves."""
    steps, inputs = read_tables(journal)
    kept = steps[steps[:, 0] < MINUTE_NS]
    rows = inputs[inputs[:, 0] < len(kept)].copy()
    rows[:, _SIZE] = 0
    update = {"steps": kept.tobytes(), "inputs": rows.tobytes(), "payloads": b""}
    return journal.model_copy(update=update)


def _continued_journal(journal: StepJournal, counts: _Counts, number: int) -> StepJournal:
    steps, inputs = (table.copy() for table in read_tables(journal))
    steps += number * MINUTE_NS
    inputs[:, _TIMES] += number * MINUTE_NS
    sent = [counts.messages[one.topic, one.source, one.boot] for one in journal.sources]
    if len(inputs):
        inputs[:, _SEQ] += number * np.array(sent)[inputs[:, _SOURCE]]
    return journal.model_copy(
        update={
            "first_step": journal.first_step + number * counts.steps[journal.service],
            "steps": steps.tobytes(),
            "inputs": inputs.tobytes(),
            "settings": "" if number else journal.settings,
        }
    )


def _restarted(sample: RawSample, counts: _Counts) -> Repeat:
    """Return how a message is repeated by services that are started anew."""
    payload = sample.payload
    if topic_of(ROBOT, sample.key) is JOURNAL:
        journal = decode(payload, StepJournal)
        payload = encode(_without_payloads(journal), journal.header)
    fields = msgpack.unpackb(payload)
    boots = {boot for _, _, boot in counts.messages}
    return lambda number: msgpack.packb(_with_boots(fields, boots, number))


def _with_boots(value: Any, boots: set[int], number: int) -> Any:
    """Return a decoded message with other boot ids."""
    if isinstance(value, Mapping):
        return {name: _with_boots(part, boots, number) for name, part in value.items()}
    if isinstance(value, list):
        return [_with_boots(part, boots, number) for part in value]
    return value + number if isinstance(value, int) and value in boots else value


def _counted(samples: Iterable[RawSample]) -> _Counts:
    counts = _Counts(Counter(), Counter())
    for sample in samples:
        topic, (_, header, _) = topic_of(ROBOT, sample.key), _split(sample.payload)
        assert topic is not None
        counts.messages[topic.name, header["source"], header["boot"]] += 1
        if topic is JOURNAL:
            journal = _without_payloads(decode(sample.payload, StepJournal))
            counts.steps[journal.service] += len(journal.steps) // (8 * len(STEP_COLUMNS))
    return counts


def write_long_log(path: Path, minutes: int, *, restarts: bool = False) -> int:
    """Write a log of ``minutes`` to the new file ``path``; return its number of messages.

    Raises:
        LoggerError: it cannot be written.
    """
    samples = record_minute()
    counts = _counted(samples)
    way = _restarted if restarts else _continued
    parts = [(sample, way(sample, counts)) for sample in samples]
    sink, delivery, due = McapSink(path, ROBOT, LoggerConfig()), DeliveryStats(), _FLUSH_NS
    with ProgressBar(path.name, minutes) as bar:
        for number in range(minutes):
            for sample, repeat in parts:
                at = min(sample.arrival_ns, MINUTE_NS - 1) + number * MINUTE_NS
                payload = repeat(number)
                header = Header.model_construct(**_split(payload)[1])
                if at >= due:
                    sink.flush()
                    due += _FLUSH_NS
                sink.write(RawSample(sample.key, payload, sample.tag, at), header)
                delivery.record(sample.key, header, len(payload), at)
            bar.advance()
    sink.note(DELIVERY_METADATA, delivery.to_metadata())
    sink.close(sync=False)
    return minutes * len(parts)


def main() -> int:
    """Write the log."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n\n")[0].partition(":")[0]
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="the new MCAP file")
    parser.add_argument("--minutes", type=int, default=60, help="its length (60)")
    parser.add_argument("--restarts", action="store_true", help="start all services every minute")
    arguments = parser.parse_args()
    count = write_long_log(arguments.out, arguments.minutes, restarts=arguments.restarts)
    print(f"{arguments.out}: {count} messages, {arguments.out.stat().st_size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
