"""The description, the hash and the tag of a schema."""

import pytest

from common.errors import SchemaError
from common.schemas import (
    Estop,
    JointCommand,
    Message,
    PlantState,
    PlantStatus,
    ServiceHealth,
)
from common.topics import ALL_TOPICS
from common.wire.codec import schema_hash, schema_tag
from common.wire.schema import describe


def test_hash_follows_names_types_and_enumerations_but_not_texts() -> None:
    class One(Message):
        """A text."""

        value: int

    class Two(Message):
        """Another text."""

        value: int

    class Three(Message):
        value: float

    Two.__name__ = Three.__name__ = "One"
    assert schema_hash(One) == schema_hash(Two)
    assert schema_hash(One) != schema_hash(Three)
    assert len({schema_hash(topic.schema) for topic in ALL_TOPICS}) == len(
        {topic.schema for topic in ALL_TOPICS}
    )


def test_version_is_part_of_tag_and_hash() -> None:
    class Estop2(Estop):
        VERSION = 2

    Estop2.__name__ = "Estop"
    assert schema_tag(Estop).startswith("trill/Estop/1;")
    assert schema_tag(Estop2).startswith("trill/Estop/2;")
    assert schema_hash(Estop) != schema_hash(Estop2)


def test_description_in_words() -> None:
    assert describe(PlantState).required["base_quaternion"] == "float64[4] unit"
    assert describe(JointCommand).required["position"] == "float64[27]"
    assert describe(PlantStatus).required["guard"] == (
        "GuardMode(SILENT=0, ACTIVE=1, HOLD=2, DAMP=3, ESTOP=4)"
    )
    links = describe(ServiceHealth).required["links"]
    assert links.startswith("list of LinkHealth{topic: str, ")
    assert "late" not in links
    assert describe(ServiceHealth).optional["links.late"] == "int"
    assert describe(PlantState).optional["reset_count"] == "int"
    assert "boot: int" in describe(PlantState).required["header"]


def test_types_the_bus_cannot_carry_are_refused() -> None:
    class Strange(Message):
        value: complex

    with pytest.raises(SchemaError, match=r"Strange\.value: the bus cannot carry"):
        schema_tag(Strange)
