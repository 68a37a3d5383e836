"""What the export writes: bytes, with the topic and the schema they belong to."""

from dataclasses import dataclass
from functools import cache
from typing import Any

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message as Protobuf


@dataclass(frozen=True, slots=True)
class SampleSchema:
    """A schema as MCAP knows it: ``ros2msg`` text or a serialised protobuf FileDescriptorSet."""

    name: str
    encoding: str
    message_encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Sample:
    """One message to be written."""

    topic: str
    schema: SampleSchema
    data: bytes


@cache
def protobuf_schema(descriptor: Any) -> SampleSchema:
    """The schema of a protobuf message, with all files it refers to."""
    found: dict[str, FileDescriptor] = {}

    def gather(file: FileDescriptor) -> None:
        if file.name not in found:
            for dependency in file.dependencies:
                gather(dependency)
            found[file.name] = file

    gather(descriptor.file)
    files = FileDescriptorSet()
    for file in found.values():
        file.CopyToProto(files.file.add())
    name = descriptor.full_name
    return SampleSchema(name, "protobuf", "protobuf", files.SerializeToString())


def protobuf_sample(topic: str, message: Protobuf) -> Sample:
    """``message`` ready for writing under ``topic``."""
    return Sample(topic, protobuf_schema(message.DESCRIPTOR), message.SerializeToString())
