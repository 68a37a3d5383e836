"""The latched emergency stop, as a record that a plant keeps in a file.

The record outlives the plant's process: a plant that is restarted comes up stopped again. A file
that cannot be understood counts as a stop, because nobody knows what it said.
"""

from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from common.files import write_whole

_MAX_BY = 64
_MAX_REASON = 200


class StopRecord(BaseModel):
    """Emergency stops so far, and whether the last one is still latched."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    latched: bool = False
    stops: int = Field(default=0, ge=0, description="stops latched so far; names the last one")
    by: str = Field(default="", max_length=_MAX_BY, description="source of the stop in force")
    reason: str = Field(default="", max_length=_MAX_REASON, description="of the stop in force")

    def pressed(self, by: str, reason: str) -> Self:
        """Return the record with one more stop, unless one is latched already."""
        if self.latched:
            return self
        return type(self)(
            latched=True, stops=self.stops + 1, by=by[:_MAX_BY], reason=reason[:_MAX_REASON]
        )

    def cleared(self, stops: int) -> Self:
        """Return the record with the stop of this number ended; unchanged for another number."""
        return type(self)(stops=self.stops) if self.latched and stops == self.stops else self


def load_stop(path: Path) -> StopRecord:
    """Return the record in ``path``; without a file one of no stops.

    A file that cannot be read or understood is a stop, with the reason in words.
    """
    try:
        return StopRecord.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return StopRecord()
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
    except ValidationError:
        problem = "is damaged"
    return StopRecord().pressed("plant", f"the record of stops {problem} ({path})")


def save_stop(path: Path, record: StopRecord) -> None:
    """Replace the record in ``path`` at once; it is on the disk when this returns.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, record.model_dump_json().encode())
