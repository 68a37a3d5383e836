"""Services describe their topics, so that a stranger can record them without knowing them.

Each live service answers queries on ``<robot>/schema/<service>`` with the keys it publishes, their
schema tags and JSON Schemas. Whoever asks ``*/schema/*`` learns which robots there are and what
they say. The answer is a msgpack map ``{key: {"tag": text, "jsonschema": text}}``.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import msgpack
import zenoh
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from common.schemas import Message
from common.topics import Topic
from common.transport.keys import key_of
from common.wire.schema import schema_tag

_MAX_ANSWER = 16 * 1024 * 1024


class Description(BaseModel):
    """What a service says of one of its keys."""

    model_config = ConfigDict(frozen=True)

    tag: str = Field(max_length=400)
    jsonschema: str

    @property
    def name(self) -> str:
        """Name and version, e.g. ``PlantState/1``; the whole tag if it is not of that form."""
        return self.tag.removeprefix("trill/").partition(";")[0] or "unnamed"


_Answer = TypeAdapter(dict[str, Description])


class SchemaServer:
    """Answers queries for the schemas of the topics that a service publishes."""

    def __init__(
        self, session: "zenoh.Session", robot: str, service: str, topics: Iterable[Topic[Any]]
    ) -> None:
        """Begin to answer on ``session`` for the ``topics`` of ``service``."""
        described = {}
        for topic in topics:
            schema: type[Message] = topic.schema
            text = json.dumps(schema.model_json_schema(), ensure_ascii=False)
            described[key_of(robot, topic, service)] = {
                "tag": schema_tag(schema), "jsonschema": text,
            }  # fmt: skip
        # Encoded now, so that the first query does not stop the service's other threads.
        answer: bytes = msgpack.packb(described)
        key = f"{robot}/schema/{service}"

        def reply(query: Any) -> None:
            with query:
                query.reply(key, answer)

        self._queryable: Any = session.declare_queryable(key, reply)

    def close(self) -> None:
        """Stop answering; the session must still be open."""
        self._queryable.undeclare()


def discover(
    session: "zenoh.Session", robot: str = "*", timeout: float = 1.0
) -> dict[str, dict[str, Description]]:
    """Query the robots on the bus, or one of them, for what their services publish.

    Returns:
        the descriptions by key, by robot; invalid answers are ignored. Services that are up answer
        at once, others are waited for ``timeout`` [s].
    """
    found: dict[str, dict[str, Description]] = {}
    replies = session.get(f"{robot}/schema/*", target=zenoh.QueryTarget.ALL, timeout=timeout)
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
