"""Record what a service takes in, step by step, and where the time of its inputs went.

The journal makes a recorded service replayable to the byte, because it says which messages each
step saw; the ledger says where the time of a message went. Both come from the same rows, see
:mod:`common.journal.tables`.
"""

import json
from collections import deque
from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np

from common.journal.stages import stage_times
from common.journal.tables import INPUT_COLUMNS, InputOutcome, InputTimes
from common.schemas import Header, InputSource, StageTime, StepJournal
from common.wire.schema import MAX_TAG

PERIOD_NS = 250_000_000
"""Between journal messages of a live service [ns]."""

_CARRIED_NS = 5_000_000_000
"""How long the payloads of a new sender are carried: a recorder may connect to it later than this
reader did."""
_CARRIED_BYTES = 8_000_000
"""Most bytes of payloads carried for one sender, and in one journal message."""
_MAX_INPUTS = 40_000
_MAX_SOURCES = 64
_MAX_SETTINGS = 1_000_000
_WINDOW_ROWS = 1000


class Journal:
    """Collects the rows of a service's steps; belongs to the service's thread.

    Its owner fetches the rows a few times a second, wanted or not. Of more than
    :data:`_MAX_INPUTS` input records between two fetches the newest are dropped and counted.
    """

    def __init__(self, service: str, settings: Mapping[str, Any] | None = None) -> None:
        """Start before the service's first step.

        Args:
            service: its name.
            settings: as :attr:`common.runtime.service.Service.settings`; left out if too long.
        """
        self._service = service
        text = json.dumps(dict(settings)) if settings else ""
        self._settings = text if len(text) <= _MAX_SETTINGS else ""
        self._lost = 0
        self._first_step = 0
        self._steps: list[tuple[int, int]] = []
        self._inputs: list[tuple[int, ...]] = []
        self._sources: dict[tuple[str, str, int, str], int] = {}
        self._payloads: list[bytes] = []
        self._carried = 0
        self._senders: dict[tuple[str, int], tuple[int, int]] = {}
        """Until when, and how many bytes more, payloads are carried, by source and boot id."""
        self._windows: dict[str, deque[tuple[int, ...]]] = {}
        self._open: list[tuple[str, tuple[int, ...]]] = []

    def begin_step(self, now_ns: int) -> None:
        """Begin a step at ``now_ns``."""
        self._steps.append((now_ns, 0))

    def record(
        self,
        topic: str,
        outcome: InputOutcome,
        header: Header | None,
        payload: bytes,
        tag: str,
        times: InputTimes,
    ) -> None:
        """Record a message taken in by the current step.

        Args:
            topic: its name.
            outcome: what became of it.
            header: None if it has no readable one; then it is not recorded.
            payload: its bytes.
            tag: schema tag of the sender.
            times: when it arrived, and so on.
        """
        if not self._steps or header is None:
            return
        full = len(self._inputs) >= _MAX_INPUTS
        index = None if full else self._index_of((topic, header.source, header.boot, tag))
        if index is None:
            self._lost += outcome is InputOutcome.APPLIED
            return
        size = self._carry(payload, (header.source, header.boot), times.arrival)
        sending = (header.captured, header.sent, header.encode)
        row = (len(self._steps) - 1, index, outcome, header.seq, *sending, *times, size)
        self._inputs.append(row)
        if outcome is InputOutcome.APPLIED:
            self._open.append((topic, (*sending, *times, self._steps[-1][0])))

    def _index_of(self, source: tuple[str, str, int, str]) -> int | None:
        """Return the index of a source in the next journal message; None if there are too many."""
        index = self._sources.get(source)
        if index is None and len(self._sources) < _MAX_SOURCES:
            index = self._sources[source] = len(self._sources)
        return index

    def _carry(self, payload: bytes, sender: tuple[str, int], arrival_ns: int) -> int:
        """Keep the payload if its sender is new; return how many bytes of it are kept."""
        known = self._senders.get(sender)
        if known is None:
            if len(self._senders) >= _MAX_SOURCES:
                return 0
            known = arrival_ns + _CARRIED_NS, _CARRIED_BYTES
        until, left = known
        size = len(payload)
        fits = arrival_ns <= until and size <= min(left, _CARRIED_BYTES - self._carried)
        self._senders[sender] = until, left - size if fits else left
        if not fits:
            return 0
        self._carried += size
        self._payloads.append(payload)
        return size

    def end_step(self, used_ns: int) -> None:
        """End the current step, whose results were sent at ``used_ns``."""
        self._steps[-1] = (self._steps[-1][0], used_ns)
        for topic, row in self._open:
            window = self._windows.get(topic)
            if window is None:
                window = self._windows[topic] = deque(maxlen=_WINDOW_ROWS)
            window.append((*row, used_ns))
        self._open.clear()

    def fetch(self) -> StepJournal | None:
        """Take out the rows collected since the last call; None if there are none."""
        if not self._steps:
            return None
        message = StepJournal(
            service=self._service,
            first_step=self._first_step,
            sources=[
                InputSource(topic=topic, source=source[:64], boot=boot, schema_tag=tag[:MAX_TAG])
                for topic, source, boot, tag in self._sources
            ],
            steps=np.array(self._steps, "<i8").tobytes(),
            inputs=np.array(self._inputs, "<i8").reshape(-1, len(INPUT_COLUMNS)).tobytes(),
            payloads=b"".join(self._payloads),
            settings="" if self._first_step else self._settings,
            lost=self._lost,
        )
        self._clear()
        return message

    def stages(self, topic: str, since_ns: int) -> list[StageTime]:
        """Return median and p99 of each stage for messages used since a time; empty if none."""
        rows = [row for row in self._windows.get(topic, ()) if row[-2] >= since_ns]
        if not rows:
            return []
        flat = np.fromiter(chain.from_iterable(rows), np.int64, len(rows) * len(rows[0]))
        return stage_times(flat.reshape(len(rows), -1))

    def _clear(self) -> None:
        self._first_step += len(self._steps)
        self._steps = []
        self._inputs = []
        self._sources = {}
        self._payloads = []
        self._carried = 0
