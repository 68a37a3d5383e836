"""Query services for the schemas of the topics that they publish.

A recorder needs them to describe topics that its own table does not contain. Each live service
answers queries on :data:`common.queries.SCHEMA` with a msgpack map ``{key: {"tag": text,
"jsonschema": text}}`` of the keys that it publishes. A query to every robot and service therefore
finds the robots on the bus and their topics.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import msgpack
import zenoh
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from common.queries import SCHEMA
from common.schemas import Message
from common.topics import Topic
from common.transport.keys import key_of
from common.wire.schema import MAX_TAG, schema_tag

_MAX_ANSWER = 16 * 1024 * 1024


class Description(BaseModel):
    """A service's description of one of its keys."""

    model_config = ConfigDict(frozen=True)

    tag: str = Field(max_length=MAX_TAG)
    jsonschema: str

    @property
    def name(self) -> str:
        """Name and version, e.g. ``PlantState/1``; the whole tag if it is not of that form."""
        return self.tag.removeprefix("trill/").partition(";")[0] or "unnamed"


_Answer = TypeAdapter(dict[str, Description])


class SchemaServer:
    """Answers queries for the schemas of a service's topics."""

    def __init__(
        self, session: "zenoh.Session", robot: str, service: str, topics: Iterable[Topic[Any]]
    ) -> None:
        """Start answering on ``session`` for the ``topics`` of ``service``."""
        described = {}
        for topic in topics:
            schema: type[Message] = topic.schema
            text = json.dumps(schema.model_json_schema(), ensure_ascii=False)
            key = key_of(robot, topic, service)
            described[key] = {"tag": schema_tag(schema), "jsonschema": text}
        # Encoded now, so that the first query does not hold up the service's other threads.
        answer: bytes = msgpack.packb(described)
        answer_key = SCHEMA.key(robot, service)

        def reply(query: Any) -> None:
            with query:
                query.reply(answer_key, answer)

        self._queryable: Any = session.declare_queryable(answer_key, reply)

    def close(self) -> None:
        """Stop answering; the session must still be open."""
        self._queryable.undeclare()


def discover(
    session: "zenoh.Session", robot: str = "*", timeout: float = 1.0
) -> dict[str, dict[str, Description]]:
    """Find the robots on the bus and the topics that they publish.

    Args:
        session: an open Zenoh session.
        robot: query this robot only.
        timeout: for answers [s]; services that are up answer at once.

    Returns:
        robot to key to description; malformed answers are left out.
    """
    found: dict[str, dict[str, Description]] = {}
    replies = session.get(
        SCHEMA.key(robot, "*"),
        target=zenoh.QueryTarget.ALL,
        # Two services of one name answer under one key; each says what it publishes.
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout,
    )
    for reply in replies:
        if reply.ok is None:
            continue
        name = str(reply.ok.key_expr).partition("/")[0]
        found.setdefault(name, {}).update(_read(reply.ok.payload.to_bytes()))
    return found


def _read(payload: bytes) -> Mapping[str, Description]:
    if len(payload) > _MAX_ANSWER:
        return {}
    try:
        return _Answer.validate_python(msgpack.unpackb(payload))
    except (ValidationError, ValueError, TypeError, msgpack.exceptions.UnpackException):
        return {}
