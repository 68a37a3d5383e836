"""Messages of other versions of a schema: read where only optional fields differ, else refused."""

import logging
from enum import IntEnum
from typing import Annotated, Any, Literal

import msgpack
import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field, create_model

from common.errors import SchemaError
from common.schemas import Header, Message
from common.schemas.arrays import ArraySpec, Float64Array, Vector2, Vector3
from common.topics import ALL_TOPICS
from common.wire.codec import decode, encode, schema_tag
from common.wire.compatibility import compatibility
from common.wire.header import wire_header
from common.wire.schema import MAX_TAG, describe, parse_tag

HEADER = Header(seq=3, stamp=5, boot=7, source="sim")


class Mode(IntEnum):
    OFF = 0
    ON = 1


class Part(BaseModel):
    """A nested model."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    name: str


class NewPart(Part):
    since: float = 1.5
    place: Vector2 = Field(default_factory=lambda: np.ones(2))


NewPart.__name__ = "Part"


class Pose(Message):
    """The first version."""

    position: Vector3
    mode: Mode
    parts: list[Part] = Field(default_factory=list)


def version(name: str = "Pose", base: type[Message] = Pose, **fields: Any) -> type[Message]:
    """Another version of a schema: with these fields, each (type, default)."""
    made: type[Message] = create_model(name, __base__=base, **fields)
    return made


def newer_pose() -> type[Message]:
    """With optional fields of every kind, one of them in a nested model."""
    return version(
        speed=(float, 0.25),
        force=(Vector3, Field(default_factory=lambda: np.array([1.0, 2.0, 3.0]))),
        state=(Mode, Mode.ON),
        label=(Literal["a", "b"], "b"),
        more=(list[Part], Field(default_factory=lambda: [Part(name="x")])),
        parts=(list[NewPart], Field(default_factory=list)),
    )


def pose(schema: type[Message] = Pose, part: type[BaseModel] = Part, **more: Any) -> Message:
    values = {"position": np.arange(3.0), "mode": Mode.ON, "parts": [part(name="p")], **more}
    return schema(**values)


def read(message: Message, schema: type[Message]) -> Any:
    """What a reader of ``schema`` makes of a message of another version."""
    return decode(encode(message, HEADER), schema, schema_tag(type(message)), injected_ns=11)


def test_fields_that_an_older_sender_lacks_get_their_defaults() -> None:
    newer = newer_pose()
    back = read(pose(), newer)
    assert back.position.tolist() == [0.0, 1.0, 2.0]
    assert (back.speed, back.state, back.label) == (0.25, Mode.ON, "b")
    assert back.force.tolist() == [1.0, 2.0, 3.0]
    assert not back.force.flags.writeable
    assert [part.name for part in back.more] == ["x"]
    assert (back.parts[0].name, back.parts[0].since) == ("p", 1.5)
    assert back.parts[0].place.tolist() == [1.0, 1.0]
    assert (back.header.seq, back.header.injected) == (3, 11)


def test_fields_of_a_newer_sender_are_ignored_and_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    newer = newer_pose()
    message = pose(newer, NewPart, speed=9.0)
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            back = read(message, Pose)
    assert type(back) is Pose
    assert back.position.tolist() == [0.0, 1.0, 2.0]
    assert back.parts == [Part(name="p")]
    (record,) = caplog.records
    assert "Pose" in record.getMessage()
    assert "'speed'" in record.getMessage()
    assert "'parts.since'" in record.getMessage()


def test_what_is_ignored_or_given_a_default_is_known_by_the_tags_alone() -> None:
    newer = newer_pose()
    added = {"speed", "force", "state", "label", "more", "parts.since", "parts.place"}
    assert set(compatibility(newer, schema_tag(Pose)).missing) == added
    assert compatibility(Pose, schema_tag(newer)).unknown == len(added)
    assert compatibility(newer, schema_tag(Pose)).unknown == 0
    assert compatibility(Pose, schema_tag(Pose)) == compatibility(newer, schema_tag(newer))


class Unit(Message):
    rotation: Annotated[Float64Array, ArraySpec((4,))]
    speed: float = 0.0


BROKEN: dict[str, tuple[type[Message], type[Message], str]] = {
    "a new required field": (Pose, version(speed=(float, ...)), "speed"),
    "a required field less": (version(speed=(float, ...)), Pose, "speed"),
    "another shape": (Pose, version(position=(Vector2, ...)), "position"),
    "another type": (Pose, version(mode=(float, ...)), "types or enumerations"),
    "another enumeration": (
        Pose,
        version(mode=(IntEnum("Mode", {"OFF": 0, "ON": 2}), ...)),
        "types or enumerations",
    ),
    "a unit vector now": (
        Unit,
        version("Unit", Unit, rotation=(Annotated[Float64Array, ArraySpec((4,), unit=True)], ...)),
        "types or enumerations",
    ),
    "required now": (Unit, version("Unit", Unit, speed=(float, ...)), "types or enumerations"),
    "an optional field of another type": (Unit, version("Unit", Unit, speed=(int, 0)), "speed"),
    "an optional list of others": (
        Pose,
        version(parts=(list[int], Field(default_factory=list))),
        "parts",
    ),
    "another name": (Pose, version("Stance"), "Stance"),
}


def sample(words: str) -> Any:
    """A value of a type in words."""
    size = words.removeprefix("float64[").partition("]")[0]
    return np.eye(int(size))[0] if size.isdigit() else 0


@pytest.mark.parametrize("case", BROKEN.values(), ids=BROKEN)
@pytest.mark.parametrize("turned", [False, True])
def test_incompatible_changes_are_refused_both_ways(
    case: tuple[type[Message], type[Message], str], turned: bool
) -> None:
    sender, reader = case[1::-1] if turned else case[:2]
    message = sender(
        **{name: sample(w) for name, w in describe(sender).required.items() if name != "header"}
    )
    with pytest.raises(SchemaError) as caught:
        read(message, reader)
    text = str(caught.value)
    for schema in (sender, reader):
        assert f"trill/{schema.__name__}/1;{schema_tag(schema).split(';')[1]}" in text
    assert case[2] in text


def test_an_optional_field_under_another_name_is_refused() -> None:
    """A duration in seconds and one in milliseconds are no defaults for each other."""
    seconds = version(duration=(float, 0.1))
    milliseconds = version(duration_ms=(float, 100.0))
    for sender, reader in ((seconds, milliseconds), (milliseconds, seconds)):
        with pytest.raises(SchemaError) as caught:
            read(pose(sender), reader)
        assert "'duration'" in str(caught.value)
        assert "'duration_ms'" in str(caught.value)


def test_a_version_that_means_something_else_is_refused() -> None:
    class Pose2(Pose):
        VERSION = 2

    Pose2.__name__ = "Pose"
    with pytest.raises(SchemaError, match=r"trill/Pose/1.*trill/Pose/2"):
        read(pose(), Pose2)


def test_a_payload_is_held_to_the_senders_tag() -> None:
    """What the tag did not announce is refused as ever."""
    newer = newer_pose()
    for change in ({"stranger": 1}, {"position": b""}):
        fields = msgpack.unpackb(encode(pose(), HEADER)) | change
        with pytest.raises(SchemaError, match=r"stranger|position"):
            decode(msgpack.packb(fields), newer, schema_tag(Pose))
    fields = msgpack.unpackb(encode(pose(), HEADER))
    del fields["mode"]
    with pytest.raises(SchemaError, match="missing field 'mode'"):
        decode(msgpack.packb(fields), newer, schema_tag(Pose))


class NewHeader(Header):
    hops: int = 0


NewHeader.__name__ = "Header"


def test_a_header_may_get_optional_fields_too() -> None:
    newer = version(header=(NewHeader, NewHeader()))
    message = pose(newer)
    payload = encode(message, NewHeader(seq=3, source="sim", hops=2))
    assert decode(payload, Pose, schema_tag(newer)).header == Header(seq=3, source="sim")
    assert wire_header(payload) == Header(seq=3, source="sim")
    assert read(pose(), newer).header == NewHeader(
        **HEADER.model_copy(update={"injected": 11}).model_dump()
    )


@pytest.mark.parametrize(
    "tag",
    [
        "",
        "trill",
        "trill/Pose/1",
        "trill/Pose/1;",
        "trill/Pose/1;0123456789ab;",
        "trill/Pose/1;0123456789ab;12ab;34cd",
        "other/Pose/1;0123456789ab",
        "trill/Pose/1;" + "x" * 10_000,
        schema_tag(Pose)[:-1],
    ],
)
def test_damaged_tags_are_refused(tag: str) -> None:
    with pytest.raises(SchemaError) as caught:
        decode(encode(pose(), HEADER), Pose, tag)
    assert len(str(caught.value)) <= 400


def test_whatever_a_newer_message_has_besides_is_harmless() -> None:
    deep: Any = 1
    for _ in range(400):
        deep = {"parts": [deep]}
    fields = msgpack.unpackb(encode(pose(), HEADER)) | {"deep": deep}
    fields["parts"][0] |= deep
    assert decode(msgpack.packb(fields), Pose, newer_tag()).parts == [Part(name="p")]
    for wrong in ([1], [[{"name": "p"}]], {"name": "p"}, 5):
        with pytest.raises(SchemaError, match="parts"):
            decode(msgpack.packb(fields | {"parts": wrong}), Pose, newer_tag())


def newer_tag() -> str:
    return schema_tag(newer_pose())


def test_tags_of_the_bus_fit_the_transport() -> None:
    for topic in ALL_TOPICS:
        parsed = parse_tag(schema_tag(topic.schema))
        assert parsed is not None
        assert parsed.name == f"trill/{topic.schema.__name__}/1"
        assert len(parsed.digests) == len(describe(topic.schema).optional)
        assert len(schema_tag(topic.schema)) < MAX_TAG - 80
    many: dict[str, Any] = {f"field{number}": (int, 0) for number in range(60)}
    with pytest.raises(SchemaError, match="60 optional fields"):
        schema_tag(version("Many", Message, **many))


def test_two_fields_with_one_digest_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.wire.schema._DIGEST_LENGTH", 0)
    with pytest.raises(SchemaError, match="same digest"):
        schema_tag(version("Twins", Message, one=(int, 0), two=(int, 0)))
