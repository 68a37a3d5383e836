"""Lets strangers ask a live service what it publishes."""

from collections.abc import Sequence
from typing import Any

from common.runtime.live.components import Component, RunnerContext
from common.topics import Topic
from common.transport.schema_query import SchemaServer


class SchemaResponder(Component):
    """Answers queries for the schemas of a service's topics."""

    def __init__(self, topics: Sequence[Topic[Any]]) -> None:
        """Describe ``topics``."""
        self._topics = topics
        self._server: SchemaServer | None = None

    def open(self, context: RunnerContext) -> None:
        """Begin to answer."""
        self._server = SchemaServer(context.robot, context.service, self._topics)
        self._server.open(context.session)

    def close(self) -> None:
        """Answer no more."""
        if self._server is not None:
            self._server.close()
