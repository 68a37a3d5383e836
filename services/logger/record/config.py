"""Configuration of the logger."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class LoggerConfig(BaseModel):
    """How the logger buffers and writes.

    What a ``kill -9`` can lose is what arrived since the last flush: ``flush_period`` plus
    ``drain_period`` and the time one write takes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    compression: Literal["zstd", "lz4", "none"] = Field(default="zstd", description="of the chunks")
    chunk_size: int = Field(
        default=1024 * 1024, ge=1024, description="a chunk is closed at this size [bytes]"
    )
    flush_period: float = Field(
        default=0.25, gt=0.0, le=0.5, description="an open chunk is closed and written after [s]"
    )
    drain_period: float = Field(
        default=0.02, gt=0.0, le=0.5, description="between looks into the queue [s]"
    )
    queue_messages: int = Field(
        default=20_000, ge=1, description="arrived but not written; more are dropped and counted"
    )
    queue_bytes: int = Field(default=64 * 1024 * 1024, ge=1, description="likewise")
    rotate_size: int | None = Field(
        default=None, ge=100_000, description="a new part is begun at this size [bytes]"
    )
    rotate_every: float | None = Field(
        default=None, ge=1.0, description="a new part is begun after this long [s]"
    )
    topics: tuple[str, ...] = Field(
        default=(), description="record only what matches one of these, e.g. 'plant/*'; empty: all"
    )
    exclude: tuple[str, ...] = Field(
        default=(), description="do not record what matches one of these, e.g. 'camera/**'"
    )
    low_disk: int = Field(
        default=1024**3, ge=0, description="less free space than this is warned of [bytes]"
    )
