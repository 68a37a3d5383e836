"""Read the tables in a journal message: a row for each step and for each message taken in.

A step is a row of :data:`STEP_COLUMNS`: ``now`` is the step's time and ``used`` the time at which
its results had been sent (0: not yet). A message taken in, an *input record*, is a row of
:data:`INPUT_COLUMNS`:

- ``step`` counts from ``first_step`` of the journal message, ``source`` is an index into its
  ``sources``;
- ``outcome`` is an :class:`InputOutcome`;
- ``captured``, ``sent`` and ``encode`` are the header's, on the sender's clock [ns];
- ``arrival`` is when the transport handed the message over, ``injected`` how long the link held
  it (-1: for ever), both on the reader's clock [ns];
- ``offset`` is the reader's clock minus the sender's [ns], :data:`UNKNOWN` if not known;
- ``decode`` is how long decoding took [ns]; ``size`` counts its bytes in ``payloads``.

Another column takes another ``VERSION`` of :class:`~common.schemas.StepJournal`: the tables are
bytes to the schema.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.errors import SchemaError
from common.schemas import StepJournal

STEP_COLUMNS = ("now", "used")
INPUT_COLUMNS = (
    "step",
    "source",
    "outcome",
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
UNKNOWN = -(2**63)
"""A clock offset that is not known."""

Table = npt.NDArray[np.int64]

_STEP, _SOURCE, _SIZE = (INPUT_COLUMNS.index(name) for name in ("step", "source", "size"))


class InputOutcome(IntEnum):
    """What became of a message that arrived."""

    APPLIED = 0
    REFUSED = 1
    STALE = 2
    LATE = 3
    """Overtaken by a newer one, or repeated."""
    LOST = 4
    """Dropped by the link on purpose."""
    FOREIGN = 5
    """From another sender than the one that is followed."""


class InputTimes(NamedTuple):
    """Times of one input record [ns]; see :data:`INPUT_COLUMNS`."""

    arrival: int
    injected: int
    offset: int
    decode: int


def read_tables(journal: StepJournal) -> tuple[Table, Table]:
    """Return the steps (n, 2) and the input records (m, 12) of a journal message.

    Raises:
        SchemaError: the bytes are no such tables, or rows refer to something that is not there.
    """
    steps = _table(journal.steps, len(STEP_COLUMNS), "steps")
    inputs = _table(journal.inputs, len(INPUT_COLUMNS), "inputs")
    if len(inputs):
        step, source, size = inputs[:, _STEP], inputs[:, _SOURCE], inputs[:, _SIZE]
        fits = (
            (step >= 0) & (step < len(steps)) & (source >= 0) & (source < len(journal.sources))
            & (size >= 0)
        )  # fmt: skip
        if not fits.all() or size.sum() != len(journal.payloads):
            raise SchemaError(
                f"the journal of {journal.service} contradicts itself: expected rows that refer to "
                f"its {len(steps)} steps, {len(journal.sources)} sources and "
                f"{len(journal.payloads)} bytes"
            )
    return steps, inputs


def _table(data: bytes, columns: int, name: str) -> Table:
    if len(data) % (8 * columns):
        raise SchemaError(
            f"StepJournal.{name}: expected rows of {columns} int64, got {len(data)} bytes"
        )
    return np.frombuffer(data, "<i8").reshape(-1, columns)
