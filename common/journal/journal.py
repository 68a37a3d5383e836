"""What a service takes in, step by step: kept for its journal and summed up in its ledger.

The journal makes a recorded service replayable to the byte, because it says which messages each
step saw; the ledger says where the time of a message went. Both come from the same rows.

A step's row: :data:`STEP_COLUMNS`. A row for each message taken in: :data:`TAKE_COLUMNS`, where

- ``step`` counts from ``first_step`` of the journal message, ``stream`` is an index into its
  ``streams``;
- ``kind`` is a :class:`Take`;
- ``captured``, ``sent`` and ``encode`` are the header's, of the sender's clock [ns];
- ``arrival`` is when the transport handed the message over, ``injected`` how long the link held
  it (-1: for ever), both of the reader's clock [ns];
- ``offset`` is the reader's clock minus the sender's [ns], :data:`UNKNOWN` if not known;
- ``decode`` is how long decoding took [ns]; ``size`` counts the bytes of it in ``payloads``.
"""

import json
from collections import deque
from collections.abc import Mapping
from enum import IntEnum
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from common.errors import SchemaError
from common.schemas import Header, StageTime, StepJournal, Stream

STEP_COLUMNS = ("now", "used")
TAKE_COLUMNS = (
    "step",
    "stream",
    "kind",
    "seq",
    "captured",
    "sent",
    "encode",
    "arrival",
    "injected",
    "offset",
    "decode",
    "size",
)
PERIOD_NS = 250_000_000
"""Between journal messages of a live service [ns]."""
UNKNOWN = -(2**63)

Table = npt.NDArray[np.int64]

_PROLOGUE_NS = 5_000_000_000
_PROLOGUE_BYTES = 8_000_000
"""Of a sender whose first messages are carried, as a recorder may be connected to it later than
this reader is; and of one journal message."""
_KEPT_TAKES = 40_000
_MAX_STREAMS = 64
_MAX_SETTINGS = 1_000_000
_WINDOW_ROWS = 1000


class Take(IntEnum):
    """What became of a message."""

    APPLIED = 0
    REFUSED = 1
    STALE = 2
    LATE = 3
    """Overtaken by a newer one, or repeated."""
    LOST = 4
    """By the link, on purpose."""


class Journal:
    """Collects rows; belongs to the service's thread.

    Whoever has one fetches the rows a few times a second, wanted or not; of more than
    :data:`_KEPT_TAKES` between two fetches the newest are given up and counted.
    """

    def __init__(self, service: str, settings: Mapping[str, Any] | None = None) -> None:
        """Start with the first step of a life; ``settings`` as :class:`StepJournal` has them."""
        self._service = service
        text = json.dumps(dict(settings)) if settings else ""
        self._settings = text if len(text) <= _MAX_SETTINGS else ""
        self._lost = 0
        self._first_step = 0
        self._steps: list[tuple[int, int]] = []
        self._takes: list[tuple[int, ...]] = []
        self._streams: dict[tuple[str, str, int], int] = {}
        self._payloads: list[bytes] = []
        self._carried = 0
        self._prologues: dict[tuple[str, int], tuple[int, int]] = {}
        """Until when and how much is carried of each life of a sender."""
        self._windows: dict[str, deque[tuple[int, ...]]] = {}
        self._open: list[tuple[str, tuple[int, ...]]] = []

    def begin(self, now_ns: int) -> None:
        """A step begins at ``now_ns``."""
        self._steps.append((now_ns, 0))

    def take(
        self,
        topic: str,
        kind: Take,
        header: Header | None,
        payload: bytes,
        times: tuple[int, int, int, int],
    ) -> None:
        """Note a message taken in by the current step.

        Args:
            topic: its name.
            kind: what became of it.
            header: None if it has no readable one.
            payload: its bytes.
            times: arrival, injected, offset and decode, see :data:`TAKE_COLUMNS`.
        """
        if not self._steps or header is None:
            return
        if len(self._takes) >= _KEPT_TAKES:
            self._lost += kind is Take.APPLIED
            return
        key = (topic, header.source, header.boot)
        stream = self._streams.get(key)
        if stream is None:
            if len(self._streams) >= _MAX_STREAMS:
                self._lost += kind is Take.APPLIED
                return
            stream = self._streams[key] = len(self._streams)
        size = self._carry(payload, (header.source, header.boot), times[0])
        sending = (header.captured, header.sent, header.encode)
        row = (len(self._steps) - 1, stream, kind, header.seq, *sending, *times, size)
        self._takes.append(row)
        if kind is Take.APPLIED:
            self._open.append((topic, (*sending, *times, self._steps[-1][0])))

    def _carry(self, payload: bytes, sender: tuple[str, int], arrival_ns: int) -> int:
        """Keep a payload that comes early in its sender's life; how many bytes of it."""
        known = self._prologues.get(sender)
        if known is None:
            if len(self._prologues) >= _MAX_STREAMS:
                return 0
            known = arrival_ns + _PROLOGUE_NS, _PROLOGUE_BYTES
        until, left = known
        size = len(payload)
        fits = arrival_ns <= until and size <= min(left, _PROLOGUE_BYTES - self._carried)
        self._prologues[sender] = until, left - size if fits else left
        if not fits:
            return 0
        self._carried += size
        self._payloads.append(payload)
        return size

    def end(self, used_ns: int) -> None:
        """The step's results were sent at ``used_ns``."""
        self._steps[-1] = (self._steps[-1][0], used_ns)
        for topic, row in self._open:
            window = self._windows.get(topic)
            if window is None:
                window = self._windows[topic] = deque(maxlen=_WINDOW_ROWS)
            window.append((*row, used_ns))
        self._open.clear()

    def fetch(self) -> StepJournal | None:
        """Take out what was collected; None if there is nothing."""
        if not self._steps:
            return None
        message = StepJournal(
            service=self._service,
            first_step=self._first_step,
            streams=[
                Stream(topic=topic, source=source[:64], boot=boot)
                for topic, source, boot in self._streams
            ],
            steps=np.array(self._steps, "<i8").tobytes(),
            takes=np.array(self._takes, "<i8").reshape(-1, len(TAKE_COLUMNS)).tobytes(),
            payloads=b"".join(self._payloads),
            settings="" if self._first_step else self._settings,
            lost=self._lost,
        )
        self._forget()
        return message

    def stages(self, topic: str, since_ns: int) -> list[StageTime]:
        """Median and p99 of each stage for messages used since a time; empty without any."""
        rows = [row for row in self._windows.get(topic, ()) if row[-2] >= since_ns]
        if not rows:
            return []
        flat = np.fromiter(chain.from_iterable(rows), np.int64, len(rows) * len(rows[0]))
        return stage_times(flat.reshape(len(rows), -1))

    def _forget(self) -> None:
        self._first_step += len(self._steps)
        self._steps = []
        self._takes = []
        self._streams = {}
        self._payloads = []
        self._carried = 0


def stage_durations(rows: Table) -> dict[str, Table]:
    """Time each message spent in each stage of its way [ns].

    Args:
        rows: (n, 9) captured, sent, encode, arrival, injected, offset, decode, step's start,
            results sent [ns].

    Returns:
        (n,) by stage, in the stages' order; of ``wire`` and ``total`` only those whose offset is
        known.
    """
    captured, sent, encode, arrival, injected, offset, decode, begun, used = rows.T
    known = offset != UNKNOWN
    return {
        "capture": sent - encode - captured,
        "encode": encode,
        "wire": (arrival - sent - offset)[known],
        "injected": injected,
        "queue": begun - arrival - injected,
        "decode": decode,
        "use": used - begun,
        "total": (used - captured - offset)[known],
    }


def stage_times(rows: Table) -> list[StageTime]:
    """Sum up messages' ways.

    Args:
        rows: as :func:`stage_durations` takes them.

    Returns:
        the stages of which there is any, in their order.
    """
    stages: dict[Any, Table] = dict(stage_durations(rows))
    return [StageTime(stage=name, **_spread(some)) for name, some in stages.items() if len(some)]


def read_tables(journal: StepJournal) -> tuple[Table, Table]:
    """Return the steps (n, 2) and the takes (m, 12) of a journal message.

    Raises:
        SchemaError: the bytes are no such tables, or refer to what is not there.
    """
    steps = _table(journal.steps, len(STEP_COLUMNS), "steps")
    takes = _table(journal.takes, len(TAKE_COLUMNS), "takes")
    if len(takes):
        fits = (
            (takes[:, 0] >= 0) & (takes[:, 0] < len(steps)) & (takes[:, 1] >= 0)
            & (takes[:, 1] < len(journal.streams)) & (takes[:, 11] >= 0)
        )  # fmt: skip
        if not fits.all() or takes[:, 11].sum() != len(journal.payloads):
            raise SchemaError(
                f"the journal of {journal.service} contradicts itself: expected rows that refer to "
                f"its {len(steps)} steps, {len(journal.streams)} streams and "
                f"{len(journal.payloads)} bytes"
            )
    return steps, takes


def _table(data: bytes, columns: int, name: str) -> Table:
    if len(data) % (8 * columns):
        raise SchemaError(
            f"StepJournal.{name}: expected rows of {columns} int64, got {len(data)} bytes"
        )
    return np.frombuffer(data, "<i8").reshape(-1, columns)


def _spread(durations: Table) -> dict[str, float]:
    ordered = np.sort(durations)
    last = len(ordered) - 1
    return {
        "median": 1e-9 * float(ordered[min(last, len(ordered) // 2)]),
        "p99": 1e-9 * float(ordered[min(last, int(0.99 * len(ordered)))]),
    }
