"""Make a long log by repeating a short one: ``python -m benchmarks.long_log OUT --minutes 60``.

The short one is a minute of a robot that walks by a script in simulated time, with small pictures,
heartbeats, health, episode marks and journals. A repetition either continues it, as one run of each
service: sequence numbers, times, steps and the numbers of gait requests go on, so that no message
is missing. Or, with ``--restarts``, every service is started anew: only boot ids differ, so that
each run can be replayed to the byte. With ``--anew`` nothing is repeated: all of it is simulated,
which takes about half as long as the log, so that one long run can be replayed to the byte.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
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
_TICKS = 100
"""Of simulated time in a second."""
_FLUSH_NS = 250_000_000
"""Between the ends of two chunks, as a recorder ends them [ns]."""
_GAITS_PER_SECOND = 1
"""More than a robot walks."""
_NUMBERED = {TELEOP_GAIT: "request_id", WBC_REPLY: "request_id"}
_TIMES = [INPUT_COLUMNS.index(name) for name in ("captured", "sent", "arrival")]
_SOURCE, _SEQ, _SIZE = (INPUT_COLUMNS.index(name) for name in ("source", "seq", "size"))

Repeat = Callable[[int], bytes]
"""Returns the bytes of a message in a repetition, numbered from 0."""


@dataclass(frozen=True)
class Part:
    """What is repeated.

    Attributes:
        span_ns: its length [ns].
        samples: its messages in the order of sending.
        messages: their number by topic, source and boot id.
        steps: number of steps by service.
    """

    span_ns: int
    samples: list[RawSample]
    messages: Counter[tuple[str, str, int]] = field(default_factory=Counter)
    steps: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        for sample in self.samples:
            topic, (_, header, _) = topic_of(ROBOT, sample.key), _split(sample.payload)
            assert topic is not None
            self.messages[topic.name, header["source"], header["boot"]] += 1
            if topic is JOURNAL:
                journal = _cut(decode(sample.payload, StepJournal), self.span_ns)
                self.steps[journal.service] += len(journal.steps) // (8 * len(STEP_COLUMNS))


def record_part(seconds: int = 60) -> Part:
    """Record a walking robot."""
    span_ns = seconds * 1_000_000_000
    operator = ScriptedOperator(random_walk(ScriptOptions(count=_GAITS_PER_SECOND * seconds)))
    services = [PlantService(SimConfig()), WbcService(), operator]
    with (
        SimTimeRunner(services, robot=ROBOT, record=True) as runner,
        ProgressBar("simulating", seconds) as bar,
    ):
        for tick in range(_TICKS * seconds):
            if tick % _TICKS == 0:
                bar.show(tick // _TICKS, seconds)
            for topic, message, source in _surroundings(tick, [one.name for one in services]):
                runner.inject(topic, message, source)
            if tick in {_TICKS // 2, _TICKS * seconds - 1}:
                action = EpisodeAction.END if tick > _TICKS else EpisodeAction.START
                runner.inject(EPISODE, EpisodeMark(episode=0, action=action, label="walk"), "mark")
            runner.run_for(1.0 / _TICKS)
        # The journals of the last steps come a little later.
        runner.run_for(0.5)
        return Part(span_ns, [one for one in runner.log if _is_within(one, span_ns)])


def _is_within(sample: RawSample, span_ns: int) -> bool:
    if sample.arrival_ns < span_ns:
        return True
    if topic_of(ROBOT, sample.key) is not JOURNAL:
        return False
    steps, _ = read_tables(decode(sample.payload, StepJournal))
    return bool(steps[0, 0] < span_ns)


def _surroundings(tick: int, services: Iterable[str]) -> Iterator[tuple[Topic[Any], Message, str]]:
    """Yield what those services send that simulated time does without."""
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


def _split(payload: bytes) -> tuple[bytes, dict[str, Any], bytes]:
    """Return a message's bytes before its header, the header, and the bytes behind it."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(payload)
    unpacker.read_map_header()
    unpacker.unpack()
    start = unpacker.tell()
    header = unpacker.unpack()
    return payload[:start], header, payload[unpacker.tell() :]


def _continued(sample: RawSample, part: Part) -> Repeat:
    """Return how a message is repeated as one run goes on."""
    start, header, rest = _split(sample.payload)
    topic = topic_of(ROBOT, sample.key)
    assert topic is not None
    span_ns, sent = part.span_ns, part.messages[topic.name, header["source"], header["boot"]]
    first, times = header["seq"], {n: header[n] for n in ("stamp", "captured", "sent")}
    if topic is JOURNAL:
        times["sent"] = min(times["sent"], span_ns - 1)

    def header_of(number: int) -> dict[str, Any]:
        shifted = {name: at + number * span_ns for name, at in times.items()}
        return {**header, **shifted, "seq": first + number * sent}

    if topic is JOURNAL:
        journal = _cut(decode(sample.payload, StepJournal), span_ns)
        return lambda number: encode(
            _continued_journal(journal, part, number), Header(**header_of(number))
        )
    counter = {**_NUMBERED, EPISODE: "episode"}.get(topic)
    if counter is not None:
        # Numbers of gait requests are times in milliseconds.
        step = 1 if topic is EPISODE else span_ns // 1_000_000
        message: Message = decode(sample.payload, topic.schema)
        value = getattr(message, counter)
        return lambda number: encode(
            message.model_copy(update={counter: value + number * step}),
            Header(**header_of(number)),
        )
    return lambda number: b"".join((start, msgpack.packb(header_of(number)), rest))


def _cut(journal: StepJournal, span_ns: int) -> StepJournal:
    """Return a journal up to the part's end, without the messages: all are in the log."""
    steps, inputs = read_tables(journal)
    kept = steps[steps[:, 0] < span_ns]
    rows = inputs[inputs[:, 0] < len(kept)].copy()
    rows[:, _SIZE] = 0
    update = {"steps": kept.tobytes(), "inputs": rows.tobytes(), "payloads": b""}
    return journal.model_copy(update=update)


def _continued_journal(journal: StepJournal, part: Part, number: int) -> StepJournal:
    steps, inputs = (table.copy() for table in read_tables(journal))
    steps += number * part.span_ns
    inputs[:, _TIMES] += number * part.span_ns
    sent = [part.messages[one.topic, one.source, one.boot] for one in journal.sources]
    if len(inputs):
        inputs[:, _SEQ] += number * np.array(sent)[inputs[:, _SOURCE]]
    return journal.model_copy(
        update={
            "first_step": journal.first_step + number * part.steps[journal.service],
            "steps": steps.tobytes(),
            "inputs": inputs.tobytes(),
            "settings": "" if number else journal.settings,
        }
    )


def _restarted(sample: RawSample, part: Part) -> Repeat:
    """Return how a message is repeated by services that are started anew."""
    payload = sample.payload
    if topic_of(ROBOT, sample.key) is JOURNAL:
        journal = decode(payload, StepJournal)
        payload = encode(_cut(journal, part.span_ns), journal.header)
    fields = msgpack.unpackb(payload)
    boots = {boot for _, _, boot in part.messages}
    return lambda number: msgpack.packb(_with_boots(fields, boots, number))


def _with_boots(value: Any, boots: set[int], number: int) -> Any:
    """Return a decoded message with other boot ids."""
    if isinstance(value, Mapping):
        return {name: _with_boots(part, boots, number) for name, part in value.items()}
    if isinstance(value, list):
        return [_with_boots(part, boots, number) for part in value]
    return value + number if isinstance(value, int) and value in boots else value


def write_long_log(path: Path, part: Part, times: int, *, restarts: bool = False) -> int:
    """Write ``part`` so many ``times`` to the new file ``path``; return the number of messages.

    Raises:
        LoggerError: it cannot be written.
    """
    way = _restarted if restarts else _continued
    parts = [(sample, way(sample, part)) for sample in part.samples]
    sink, delivery, due = McapSink(path, ROBOT, LoggerConfig()), DeliveryStats(), _FLUSH_NS
    with ProgressBar(path.name, times) as bar:
        for number in range(times):
            for sample, repeat in parts:
                at = min(sample.arrival_ns, part.span_ns - 1) + number * part.span_ns
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
    return times * len(parts)


def main() -> int:
    """Write the log."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n\n")[0].partition(":")[0]
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="the new MCAP file")
    parser.add_argument("--minutes", type=int, default=60, help="its length (60)")
    ways = parser.add_mutually_exclusive_group()
    ways.add_argument("--restarts", action="store_true", help="start all services every minute")
    ways.add_argument("--anew", action="store_true", help="simulate all of it, repeat nothing")
    arguments = parser.parse_args()
    seconds, times = (60 * arguments.minutes, 1) if arguments.anew else (60, arguments.minutes)
    part = record_part(seconds)
    count = write_long_log(arguments.out, part, times, restarts=arguments.restarts)
    print(f"{arguments.out}: {count} messages, {arguments.out.stat().st_size / 1e6:.0f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
