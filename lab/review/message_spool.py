"""Keep messages of a run in a temporary file, so that a long run takes no more memory."""

import tempfile
from array import array
from collections.abc import Iterable, Sequence
from typing import Generic, TypeVar, overload

from common.schemas import Message
from common.spool import spool_failure
from common.wire.codec import encode
from common.wire.decoder import Decoder

M = TypeVar("M", bound=Message)

_IN_MEMORY = 2**21
"""Messages that take no more than this have no file [bytes]."""


class MessageSpool(Sequence[M], Generic[M]):
    """Messages of one schema, decoded whenever they are asked for.

    A slice is a spool with a file of its own. The file is in the directory for temporary files
    and gone with the object.
    """

    def __init__(self, schema: type[M], messages: Iterable[M] = ()) -> None:
        """Start with ``messages``."""
        self._schema = schema
        self._decoder = Decoder(schema)
        self._ends = array("q", [0])
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY, prefix="trill-")  # noqa: SIM115
        for message in messages:
            self.append(message)

    def append(self, message: M) -> None:
        """Append a message.

        Raises:
            TrillError: the temporary file cannot be written.
        """
        self._write(encode(message, message.header))

    def __len__(self) -> int:
        return len(self._ends) - 1

    @overload
    def __getitem__(self, place: int) -> M: ...

    @overload
    def __getitem__(self, place: slice) -> "MessageSpool[M]": ...

    def __getitem__(self, place: int | slice) -> "M | MessageSpool[M]":
        numbers = range(len(self))[place]
        if isinstance(numbers, int):
            return self._decoder.decode(self._read(numbers))
        part = MessageSpool(self._schema)
        for number in numbers:
            part._write(self._read(number))
        return part

    def _write(self, payload: bytes) -> None:
        try:
            self._file.seek(self._ends[-1])
            self._file.write(payload)
        except OSError as error:
            raise spool_failure(error) from error
        self._ends.append(self._ends[-1] + len(payload))

    def _read(self, number: int) -> bytes:
        begin, end = self._ends[number : number + 2]
        try:
            self._file.seek(begin)
            return self._file.read(end - begin)
        except OSError as error:
            raise spool_failure(error) from error
