"""Samples of an exported file: encoded messages with their topics and schemas."""

from dataclasses import dataclass
from functools import cache
from typing import Any

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message as Protobuf


@dataclass(frozen=True, slots=True)
class SampleSchema:
    """A schema in MCAP: ``ros2msg`` text or a serialised protobuf FileDescriptorSet."""

    name: str
    encoding: str
    message_encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Sample:
    """One encoded message of an exported topic."""

    topic: str
    schema: SampleSchema
    data: bytes


@cache
def protobuf_schema(descriptor: Any) -> SampleSchema:
    """Return the schema of a protobuf message, with all files it refers to."""
    found: dict[str, FileDescriptor] = {}

    def collect(file: FileDescriptor) -> None:
        if file.name not in found:
            for dependency in file.dependencies:
                collect(dependency)
            found[file.name] = file

    collect(descriptor.file)
    files = FileDescriptorSet()
    for file in found.values():
        file.CopyToProto(files.file.add())
    name = descriptor.full_name
    return SampleSchema(name, "protobuf", "protobuf", files.SerializeToString())


def protobuf_sample(topic: str, message: Protobuf) -> Sample:
    """Return ``message`` encoded for ``topic``."""
    return Sample(topic, protobuf_schema(message.DESCRIPTOR), message.SerializeToString())
