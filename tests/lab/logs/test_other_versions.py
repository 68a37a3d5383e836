"""A log written before some optional fields were added is read and replayed; others are refused."""

import re
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path

import msgpack
import numpy as np
import pytest

from common.journal.tables import INPUT_COLUMNS
from common.schemas import PlantState
from common.topics import ALL_TOPICS, JOURNAL, PLANT_STATE
from common.transport.tap import RawSample
from common.wire.header import wire_header
from common.wire.schema import optional_digests, schema_tag
from lab.logs.replay_check import Checker, CheckOptions, runs_in
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from tests.golden.make import GOLDEN

LACKING = ("reset_count", "neck_pitch", "reason", "lost")
"""Optional fields of states, set-points, replies and journals; each has its default in the log."""
OTHER_PROCESSORS = 1e-6
"""See tests/golden/README.md."""
SIZE = INPUT_COLUMNS.index("size")

Change = Callable[[str], str]


def older_tag(tag: str) -> str:
    """The tag of the schema without the optional fields."""
    name, required, *digests = tag.split(";")
    schema = next(t.schema for t in ALL_TOPICS if schema_tag(t.schema) == tag)
    gone = {digest for digest, path in optional_digests(schema).items() if path in LACKING}
    kept = re.findall("....", "".join(digests))
    left = "".join(digest for digest in kept if digest not in gone)
    return ";".join([name, required, left] if left else [name, required])


def older_payload(payload: bytes) -> bytes:
    fields = msgpack.unpackb(payload)
    return bytes(msgpack.packb({k: v for k, v in fields.items() if k not in LACKING}))


def older_journal(payload: bytes, retag: Change) -> bytes:
    """As :func:`older_payload`, and so are the messages that the journal carries."""
    fields = msgpack.unpackb(older_payload(payload))
    inputs = np.frombuffer(fields["inputs"], "<i8").reshape(-1, len(INPUT_COLUMNS)).copy()
    ends = list(accumulate(inputs[:, SIZE].tolist()))
    carried = [fields["payloads"][a:b] for a, b in zip([0, *ends], ends, strict=False)]
    older = [older_payload(one) if one else one for one in carried]
    inputs[:, SIZE] = [len(one) for one in older]
    fields |= {"inputs": inputs.tobytes(), "payloads": b"".join(older)}
    for source in fields["sources"]:
        source["schema_tag"] = retag(source["schema_tag"])
    return bytes(msgpack.packb(fields))


def older_log(path: Path, retag: Change = older_tag) -> Path:
    """The golden log as an older version would have written it."""
    sink = McapSink(path, "draco3", LoggerConfig())
    for entry in LogReader(GOLDEN).raw_messages():
        is_journal = entry.topic is JOURNAL
        payload = (
            older_journal(entry.payload, retag) if is_journal else older_payload(entry.payload)
        )
        sample = RawSample(entry.key, payload, retag(entry.tag), entry.log_time)
        sink.write(sample, wire_header(payload))
    sink.close()
    return path


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return older_log(tmp_path_factory.mktemp("old") / "log.mcap")


def test_every_message_of_an_older_log_is_read(old: Path) -> None:
    then, now = LogReader(old), LogReader(GOLDEN)
    tags = {entry.topic: entry.tag for entry in then.raw_messages()}
    older_schema, schema = tags[PLANT_STATE], schema_tag(PlantState)
    assert older_schema != schema
    assert older_schema.split(";")[:2] == schema.split(";")[:2]
    pairs = list(zip(then.messages(), now.messages(), strict=True))
    assert len(pairs) > 900
    assert sum(then.refused.values()) == 0
    for (topic, older), (_, newer) in pairs:
        if topic is not JOURNAL:
            assert repr(older) == repr(newer)


def test_an_older_log_is_replayed(old: Path) -> None:
    (run,) = runs_in(old)
    assert run.obstacle == ""
    report = Checker(old, CheckOptions(tolerance=OTHER_PROCESSORS)).check(run, lambda *_: None)
    assert report.stopped == ""
    assert report.identical
    assert report.outputs["wbc/command"].compared == 225
    # Replies have a field that the older ones lack, so their bytes cannot be the same.
    reply = report.outputs["wbc/reply"]
    assert (reply.close, reply.compared) == (1, 1)


def with_other_hash(schema: str) -> Change:
    """The older tags, but one schema's required fields have another hash."""
    return lambda tag: re.sub(rf"(trill/{schema}/1);[0-9a-f]*", r"\1;0123456789ab", older_tag(tag))


def test_a_log_with_an_incompatible_input_is_refused(tmp_path: Path) -> None:
    log = older_log(tmp_path / "log.mcap", with_other_hash("PlantState"))
    reader = LogReader(log)
    assert all(topic is not PLANT_STATE for topic, _ in reader.messages())
    assert reader.refused == {"plant/state": 460}
    assert "trill/PlantState/1;0123456789ab" in reader.last_refusal
    (run,) = runs_in(log)
    report = Checker(log, CheckOptions()).check(run, lambda *_: None)
    assert not report.identical
    assert "cannot be read" in report.stopped
    assert "trill/PlantState/1" in report.stopped


def test_a_log_with_an_incompatible_journal_cannot_be_replayed(tmp_path: Path) -> None:
    log = older_log(tmp_path / "log.mcap", with_other_hash("StepJournal"))
    (run,) = runs_in(log)
    assert "another version" in run.obstacle
    assert "trill/StepJournal/1" in run.obstacle
