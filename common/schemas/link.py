"""Changes of the delays injected on links."""

from pydantic import Field

from common.schemas.base import Message


class LinkChange(Message):
    """The link in front of one input of a service has changed.

    Published by the consumer; also when it starts, for each link that it starts with.
    """

    service: str = Field(max_length=64, description="the consumer")
    topic: str = Field(max_length=64)
    link: str = Field(max_length=200, description="what is injected from now on; empty: nothing")
    previous: str = Field(default="", max_length=200)
    reason: str = Field(default="", max_length=64, description="start, request or peer")
