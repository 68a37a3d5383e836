"""Decode the messages of one input, which are mostly alike."""

from typing import Any, Generic, TypeVar, cast

from common.schemas import Message
from common.wire.arrays import array_layout
from common.wire.builder import has_validators
from common.wire.codec import decode
from common.wire.schema import schema_tag
from common.wire.template import Reader, Template, template_of

M = TypeVar("M", bound=Message)

_FIRST_COUNT = 128
"""Smaller sequence numbers have no place of their own in a message's bytes."""
_MAX_TEMPLATES = 8
_SAVED, _TRIED, _PRICE = 16, 1, 256
"""What a message that is like a template adds to the balance, what another one does, and what it
takes to make a template. That is about the relation of their times."""
_HIGHEST_BALANCE = 4 * _PRICE


class Decoder(Generic[M]):
    """Decodes as :func:`common.wire.codec.decode` does, and in half the time if messages are alike.

    It remembers a few good messages as templates. Where these save no time, because messages
    differ in more than a template allows, new ones are made seldom.
    """

    def __init__(self, schema: type[M]) -> None:
        """Start without templates for messages of type ``schema``."""
        self._schema = schema
        self._tag = schema_tag(schema)
        self._arrays = array_layout(schema)
        # A validator may judge a message by what is in its arrays.
        self._learns = bool(self._arrays.specs) and not has_validators(schema)
        self._templates: dict[int, Template] = {}
        """By the size of their messages."""
        self._readers: dict[int, Reader] = {}
        """Those of the templates."""
        self._balance = _HIGHEST_BALANCE
        """Of the time that templates have saved and cost."""

    def decode(self, payload: bytes, tag: str | None = None, injected_ns: int = 0) -> M:
        """Return the message in ``payload``; arguments and errors are those of ``decode``."""
        own = tag is None or tag == self._tag
        read = self._readers.get(len(payload)) if own else None
        if read is not None:
            like = read(payload, injected_ns)
            if like is not None:
                if self._balance < _HIGHEST_BALANCE:
                    self._balance += _SAVED
                return cast(M, like)
        message = decode(payload, self._schema, tag, injected_ns)
        if own and self._learns and message.header.seq >= _FIRST_COUNT:
            self._balance += _TRIED
            if self._balance >= _PRICE:
                self._balance -= _PRICE
                self._remember(payload, message)
        return message

    def _remember(self, payload: bytes, message: M) -> None:
        before = self._templates.get(len(payload))
        template = template_of(payload, message, self._arrays, before)
        if template is not None:
            if len(self._templates) >= _MAX_TEMPLATES:
                self._templates.clear()
                self._readers.clear()
            self._templates[len(payload)] = template
            self._readers[len(payload)] = template.reader()


class Decoders:
    """Decodes the messages of many keys, those of each by a :class:`Decoder` of its own."""

    def __init__(self) -> None:
        """Start without any."""
        self._decoders: dict[str, Decoder[Any]] = {}

    def decode(
        self,
        key: str,
        payload: bytes,
        schema: type[M],
        tag: str | None = None,
        injected_ns: int = 0,
    ) -> M:
        """Return the message in ``payload``, as :func:`common.wire.codec.decode` does.

        ``key`` stands for messages that are mostly alike, and that have one schema.
        """
        decoder = self._decoders.get(key)
        if decoder is None:
            decoder = self._decoders[key] = Decoder(schema)
        return cast(M, decoder.decode(payload, tag, injected_ns))
