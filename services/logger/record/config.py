"""Configuration of the logger."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class LoggerConfig(BaseModel):
    """Buffering, file format and selection of topics of the logger.

    A ``kill -9`` loses at most what arrived since the last flush: in ``flush_period`` plus
    ``drain_period`` and the time that one write takes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    compression: Literal["zstd", "lz4", "none"] = Field(
        default="zstd", description="compression of the chunks"
    )
    chunk_size: int = Field(
        default=1024 * 1024, ge=1024, description="size at which a chunk is closed [bytes]"
    )
    flush_period: float = Field(
        default=0.25,
        gt=0.0,
        le=0.5,
        description="time after which an open chunk is closed and written [s]",
    )
    drain_period: float = Field(
        default=0.02, gt=0.0, le=0.5, description="period at which the queue is emptied [s]"
    )
    queue_messages: int = Field(
        default=20_000,
        ge=1,
        description="capacity of the queue; further messages are dropped and counted",
    )
    queue_bytes: int = Field(
        default=64 * 1024 * 1024, ge=1, description="capacity of the queue [bytes]"
    )
    rotate_size: int | None = Field(
        default=None, ge=100_000, description="size at which a new segment is begun [bytes]"
    )
    rotate_every: float | None = Field(
        default=None, ge=1.0, description="time after which a new segment is begun [s]"
    )
    topics: tuple[str, ...] = Field(
        default=(),
        description="record only what matches one of these patterns, e.g. 'plant/*'; empty: all",
    )
    exclude: tuple[str, ...] = Field(
        default=(), description="do not record what matches one of these patterns, e.g. 'camera/**'"
    )
    low_disk: int = Field(
        default=1024**3, ge=0, description="free disk space below which a warning is given [bytes]"
    )
    min_free: int = Field(
        default=100_000_000,
        ge=0,
        description="free disk space below which the recording ends, whole [bytes]",
    )
    keep_size: int | None = Field(
        default=None,
        ge=200_000,
        description="size of all segments beyond which the oldest are deleted; needs rotation "
        "[bytes]",
    )
    keep_segments: int | None = Field(
        default=None,
        ge=1,
        description="number of segments beyond which the oldest are deleted; needs rotation",
    )

    @property
    def rotates(self) -> bool:
        """Whether a new segment is begun now and then."""
        return self.rotate_size is not None or self.rotate_every is not None

    @model_validator(mode="after")
    def _limits_need_segments(self) -> Self:
        if not self.rotates and (self.keep_size is not None or self.keep_segments is not None):
            raise ValueError(
                "keep_size and keep_segments delete whole segments: expected rotate_size or "
                "rotate_every beside them, got neither"
            )
        return self
