"""Marks that divide a recording into episodes."""

from enum import IntEnum

from pydantic import Field

from common.schemas.base import Message


class EpisodeAction(IntEnum):
    """Change of an episode."""

    START = 0
    END = 1
    DISCARD = 2


class EpisodeMark(Message):
    """Start or end of an episode; an episode that is discarded ends too."""

    episode: int = Field(ge=0, description="counts from 0 within a recording")
    action: EpisodeAction
    label: str = Field(default="", max_length=200, description="task, condition, remark")
