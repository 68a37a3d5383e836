"""Lets strangers ask a live service what it publishes."""

from collections.abc import Sequence
from typing import Any

from common.bus.describe import SchemaServer
from common.runtime.aides import Aide, Place
from common.topics import Topic


class Describing(Aide):
    """Answers queries for the schemas of a service's topics."""

    def __init__(self, topics: Sequence[Topic[Any]]) -> None:
        """Describe ``topics``."""
        self._topics = topics
        self._server: SchemaServer | None = None

    def open(self, place: Place) -> None:
        """Begin to answer."""
        self._server = SchemaServer(place.robot, place.service, self._topics)
        self._server.open(place.session)

    def close(self) -> None:
        """Answer no more."""
        if self._server is not None:
            self._server.close()
