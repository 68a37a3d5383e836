"""The latency breakdown of a log: exact figures, links over time, files and texts."""

import csv
from collections.abc import Collection, Iterator
from io import StringIO
from math import isnan
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rich.console import Console

from common.journal.ledger import Ledger
from common.journal.stages import STAGES
from common.journal.tables import UNKNOWN, InputOutcome
from common.schemas import Header, InputSource, LinkChange, LinkHealth, Message, StepJournal
from common.topics import HEALTH, JOURNAL, LINK_CHANGE, Topic
from common.transport.keys import key_of
from common.wire.codec import encode, schema_tag
from lab.cli.main import main
from lab.errors import LabError
from lab.logs.ledger_log import ledger_table, render, write_csv
from lab.monitor.ledger_text import short_ms, stage_cells
from services.logger.read.reader import RecordedMessage
from tests.common.transport.support import health as example_health

MS = 1_000_000
SECOND = 1_000_000_000
CLOCK = 100 * SECOND
"""The consumer's clock is ahead of the logger's by this."""


def row(step: int, source: int, at_ns: int, **values: int) -> list[int]:
    """A message that arrived at a time of the consumer's clock: 3 ms wire, 1 ms encode."""
    offset = values.get("offset", -5 * SECOND)
    sent = at_ns - 3 * MS - (0 if offset == UNKNOWN else offset)
    return [
        step,
        source,
        values.get("outcome", InputOutcome.APPLIED),
        values.get("seq", 0),
        sent - 3 * MS,
        sent,
        MS,
        at_ns,
        values.get("injected", 0),
        offset,
        values.get("decode", MS // 10),
        0,
    ]


def journal(at_s: float, inputs: list[list[int]], steps: int = 1) -> StepJournal:
    """Steps 10 ms after ``at_s`` of the consumer's clock, used 5 ms later."""
    begun = round(at_s * SECOND) + 10 * MS
    return StepJournal(
        header=Header(sent=begun + 20 * MS, source="wbc", boot=3),
        service="wbc",
        first_step=0,
        sources=[
            InputSource(topic="teleop/setpoint", source="teleop", boot=1, schema_tag=""),
            InputSource(topic="plant/state", source="sim", boot=2, schema_tag=""),
        ],
        steps=np.array([[begun, begun + 5 * MS]] * steps, "<i8").tobytes(),
        inputs=np.array(inputs, "<i8").reshape(-1, 12).tobytes(),
    )


def change(at_s: float, link: str) -> LinkChange:
    header = Header(sent=round(at_s * SECOND), source="wbc", boot=3)
    return LinkChange(header=header, service="wbc", topic="teleop/setpoint", link=link)


class FakeLog:
    """Plays a log reader."""

    def __init__(self, *pairs: tuple[Topic[Any], Message]) -> None:
        self.path = Path("made up.mcap")
        self._pairs = pairs
        self.start_ns, self.end_ns = (pairs[i][1].header.sent - CLOCK for i in (0, -1))

    def raw_messages(self, topics: Collection[Topic[Any]]) -> Iterator[RecordedMessage]:
        for topic, message in self._pairs:
            assert topic in topics
            sent = message.header.sent
            yield RecordedMessage(
                key=key_of("draco3", topic, message.header.source),
                topic=topic,
                tag=schema_tag(type(message)),
                payload=encode(message, message.header),
                log_time=sent - CLOCK,
                time_ns=sent - CLOCK,
                publish_time=sent,
                sequence=0,
            )


def second(number: int) -> StepJournal:
    """One set-point, held up ``number`` ms by the link, and two states in second ``number``."""
    at = 200.0 + number
    at_ns = round(at * SECOND)
    inputs = [
        row(0, 0, at_ns, injected=number * MS),
        row(0, 1, at_ns),
        row(0, 1, at_ns, outcome=InputOutcome.STALE),
    ]
    return journal(at, inputs)


def full_log(seconds: int = 10) -> Any:
    return FakeLog(*[(JOURNAL, second(number)) for number in range(seconds)])


def as_text(log: Any) -> str:
    console = Console(file=StringIO(), width=140)
    with console.capture() as captured:
        console.print(render(ledger_table(log), "made up"))
    return captured.get()


def test_figures_are_those_of_the_rows() -> None:
    table = ledger_table(full_log())
    state, setpoint = table.inputs
    assert (state.topic, state.consumer, state.applied) == ("plant/state", "wbc", 10)
    assert state.counts == {InputOutcome.APPLIED: 10, InputOutcome.STALE: 10}
    figures = {stage.stage: (stage.median, stage.p99) for stage in state.stages}
    assert tuple(figures) == STAGES
    expected = {
        "capture": 2.0, "encode": 1.0, "wire": 3.0, "injected": 0.0, "queue": 10.0, "decode": 0.1,
        "use": 5.0, "total": 21.0,
    }  # fmt: skip
    assert {name: 1e3 * median for name, (median, _) in figures.items()} == pytest.approx(expected)
    injected = {stage.stage: stage for stage in setpoint.stages}["injected"]
    assert (1e3 * injected.median, 1e3 * injected.p99) == pytest.approx((5.0, 9.0))
    assert table.seconds == pytest.approx(9.0)


def test_a_span_is_of_the_logs_time() -> None:
    table = ledger_table(full_log(), begin=2.5, end=5.5)
    setpoint = table.inputs[1]
    assert (1e3 * setpoint.samples["injected"]).tolist() == pytest.approx([3.0, 4.0, 5.0])
    assert table.seconds == pytest.approx(3.0)
    with pytest.raises(LabError, match="has no ledger"):
        ledger_table(full_log(), begin=20.0)


def test_an_unknown_clock_is_left_out_of_wire_and_total() -> None:
    at = 200 * SECOND
    inputs = [row(0, 1, at), row(0, 1, at, offset=UNKNOWN), row(0, 1, at, offset=UNKNOWN)]
    log: Any = FakeLog((JOURNAL, journal(200.0, inputs)))
    (state,) = ledger_table(log).inputs
    assert {name: len(some) for name, some in state.samples.items()} == dict.fromkeys(STAGES, 3) | {
        "wire": 1,
        "total": 1,
    }


def test_links_are_separated_over_time() -> None:
    log: Any = FakeLog(
        (LINK_CHANGE, change(200.0, "2ms")),
        *[(JOURNAL, second(number)) for number in range(5)],
        (LINK_CHANGE, change(204.5, "7ms loss=10%")),
        (
            JOURNAL,
            journal(205.0, [row(0, 0, 205 * SECOND, outcome=InputOutcome.LOST, injected=-1)]),
        ),
        *[(JOURNAL, second(number)) for number in range(6, 9)],
        (LINK_CHANGE, change(208.5, "")),
        (JOURNAL, second(9)),
    )
    first, later = ledger_table(log).links
    assert (first.link, first.passed, first.lost) == ("2ms", 5, 0)
    assert (1e3 * first.requested_mean, 1e3 * first.achieved_mean) == pytest.approx((2.0, 2.0))
    assert (later.link, later.passed, later.lost) == ("7ms loss=10%", 3, 1)
    assert (1e3 * later.requested_p99, 1e3 * later.achieved_mean) == pytest.approx((7.0, 7.0))


def test_health_gives_the_delay_of_links_without_a_change_message() -> None:
    link = LinkHealth(
        topic="teleop/setpoint", received=1, rate=1.0, age=0.1, gaps=0, refused=0,
        link="trace(gone.csv)", requested_mean=0.25, requested_p99=0.5,
    )  # fmt: skip
    health = example_health("wbc").model_copy(
        update={"links": [link], "header": Header(sent=200 * SECOND, source="wbc")}
    )
    both = (LINK_CHANGE, change(200.001, "trace(gone.csv)"))
    for extra in ((), (both,)):
        log: Any = FakeLog((HEALTH, health), *extra, (JOURNAL, second(0)), (JOURNAL, second(1)))
        (found,) = ledger_table(log).links
        assert (found.requested_mean, found.requested_p99, found.passed) == (0.25, 0.5, 2)


def test_the_requested_delay_of_an_unreadable_link_is_unknown() -> None:
    log: Any = FakeLog((LINK_CHANGE, change(200.0, "magic")), (JOURNAL, second(1)))
    (found,) = ledger_table(log).links
    assert isnan(found.requested_mean)
    assert "magic" in as_text(log)


def test_damaged_journals_are_counted_and_passed_over() -> None:
    bad = second(1).model_copy(update={"inputs": bytes(95)})
    ledger = Ledger()
    ledger.add(bad)
    assert (ledger.unreadable, ledger.rows()) == (1, [])
    log: Any = FakeLog((JOURNAL, bad), (JOURNAL, second(2)))
    assert ledger_table(log).unreadable == 1
    assert "1 messages could not be used" in as_text(log)


def test_a_person_sees_every_input_and_what_was_not_used() -> None:
    text = as_text(full_log())
    assert "teleop/setpoint > wbc" in text
    assert "plant/state > wbc 10 stale" in text
    line = next(line for line in text.splitlines() if line.startswith("plant/state > wbc"))
    assert line.split()[3:] == [
        "10", "2.0/2.0", "1.0/1.0", "3.0/3.0", "0/0", "10/10", ".10/.10", "5.0/5.0", "21/21",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0"),
        (4e-6, "0"),
        (4e-5, ".04"),
        (-4e-5, "-.04"),
        (0.000999, "1.0"),
        (0.00424, "4.2"),
        (0.0424, "42"),
        (1.25, "1250"),
        (12.5, "12k"),
        (float("nan"), "-"),
    ],
)
def test_milliseconds_are_short(seconds: float, text: str) -> None:
    assert short_ms(seconds) == text


def test_unknown_stages_are_dashes() -> None:
    assert stage_cells([]) == ["-"] * len(STAGES)


def test_csv_has_every_stage(tmp_path: Path) -> None:
    path = tmp_path / "ledger.csv"
    write_csv(path, ledger_table(full_log()))
    rows = list(csv.DictReader(path.open()))
    assert len(rows) == 2 * len(STAGES)
    wire = next(r for r in rows if (r["topic"], r["stage"]) == ("plant/state", "wire"))
    assert wire["count"] == "10"
    assert float(wire["median_s"]) == pytest.approx(0.003)
    with pytest.raises(LabError, match="cannot write"):
        write_csv(tmp_path / "nowhere" / "x.csv", ledger_table(full_log()))


def test_command_writes_table_and_plot(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.logger.read.reader.LogReader", lambda _path: full_log())
    plot = tmp_path / "ledger.png"
    assert main(["ledger", "any.mcap", "--from", "1", "--plot", str(plot)]) == 0
    assert "teleop/setpoint > wbc" in capsys.readouterr().out
    image = cv2.imread(str(plot))
    assert image is not None
    # What the link held the set-points up for is spread out, as one box.
    assert (image == (178, 133, 76)).all(axis=2).sum() > 20


@pytest.mark.parametrize(
    ("arguments", "code", "complaint"),
    [
        (["missing.mcap"], 1, "cannot open the log"),
        (["missing.mcap", "--from", "5", "--until", "4"], 2, "expected 0 <= --from < --until"),
        (["any.mcap", "--plot", "no/such/dir.png"], 2, "cannot write"),
        (["any.mcap", "--plot", "plot.txt"], 2, "ends in .png"),
    ],
)
def test_mistakes_are_explained(
    arguments: list[str],
    code: int,
    complaint: str,
    capsys: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if arguments[0] == "any.mcap":
        monkeypatch.setattr("services.logger.read.reader.LogReader", lambda _path: full_log())
    assert main(["ledger", *arguments]) == code
    assert complaint in capsys.readouterr().err
