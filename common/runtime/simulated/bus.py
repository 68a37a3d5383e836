"""Carry messages between simulated services: encoded once, delivered at once, recorded."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from common.inbox.inbox import Inbox
from common.schemas import Message
from common.topics import Topic
from common.transport.keys import key_of
from common.transport.tap import RawSample
from common.wire.codec import decode, encode_body, schema_tag, with_header
from common.wire.decoder import Decoder
from common.wire.stamper import HeaderStamper

M = TypeVar("M", bound=Message)


class SimBus:
    """Delivers what is sent to inboxes, callbacks and the record, in the order of sending.

    Attributes:
        log: every message so far, if recording.
    """

    def __init__(
        self,
        clock: Callable[[], int],
        *,
        seed: int = 0,
        robot: str = "draco3",
        record: bool = False,
    ) -> None:
        """Start without readers.

        Args:
            clock: returns the virtual time [ns].
            seed: of boot ids.
            robot: first part of the keys in the record.
            record: keep every message in :attr:`log`, also those without a reader.
        """
        self.log: list[RawSample] = []
        self._clock = clock
        self._seed = seed
        self._robot = robot
        self._record = record
        self._readers: defaultdict[str, list[Inbox]] = defaultdict(list)
        self._callbacks: defaultdict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self._newest: dict[str, bytes | None] = {}
        """Payload of the newest message by the name of its topic, where somebody asks for it."""

    def boot(self, source: str, run: int) -> int:
        """Return the boot id of a source's ``run``-th run."""
        text = f"{self._seed} {source} {run}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "big")

    def stamper(self, source: str, run: int) -> HeaderStamper:
        """Return a stamper for one publisher of a source's ``run``-th run."""
        return HeaderStamper(source, self.boot(source, run), self._clock)

    def connect(self, inboxes: Iterable[Inbox]) -> None:
        """Deliver to these inboxes from now on, in this order and to no other."""
        self._readers = defaultdict(list)
        for inbox in inboxes:
            for name in inbox.topics:
                self._readers[name].append(inbox)

    def on_message(self, topic: Topic[M], callback: Callable[[M], None]) -> None:
        """Call ``callback`` with every message of ``topic``, decoded, when it is sent."""
        self._callbacks[topic.name].append(callback)

    def newest(self, topic: Topic[M]) -> Callable[[], M | None]:
        """Return a function that decodes the newest message of ``topic``; None: none was sent."""
        name, decoder = topic.name, Decoder(topic.schema)
        self._newest.setdefault(name, None)

        def read() -> M | None:
            payload = self._newest[name]
            return None if payload is None else decoder.decode(payload)

        return read

    def wanted(self, topic: Topic[Any]) -> bool:
        """Whether a message of ``topic`` would be delivered or recorded."""
        name = topic.name
        return bool(
            self._record or self._readers[name] or self._callbacks[name] or name in self._newest
        )

    def send(
        self,
        stamper: HeaderStamper,
        source: str,
        topic: Topic[Any],
        message: Message,
        own: Inbox | None = None,
    ) -> None:
        """Encode a message once and deliver it; it is only counted if it is not wanted.

        Args:
            stamper: of the publisher.
            source: its service.
            topic: of the message.
            message: to be sent.
            own: the sender's inbox, which it is not delivered to.

        Raises:
            SchemaError: the message does not fit the wire.
        """
        name = topic.name
        readers, callbacks = self._readers[name], self._callbacks[name]
        if not (readers or callbacks or self._record or name in self._newest):
            stamper.count += 1
            return
        now = self._clock()
        payload = with_header(message, encode_body(message), stamper.next(message, now))
        for inbox in readers:
            if inbox is not own:
                inbox.offer(name, payload, now)
        if self._record:
            schema: type[Message] = topic.schema
            key = key_of(self._robot, topic, source)
            self.log.append(RawSample(key, payload, schema_tag(schema), now))
        if name in self._newest:
            self._newest[name] = payload
        if callbacks:
            decoded = decode(payload, topic.schema)
            for callback in callbacks:
                callback(decoded)

    def digest(self) -> str:
        """Return the SHA-256 over time, key and payload of everything in :attr:`log`."""
        total = hashlib.sha256()
        for sample in self.log:
            head = f"{sample.arrival_ns} {sample.key} {len(sample.payload)}\n"
            total.update(head.encode())
            total.update(sample.payload)
        return total.hexdigest()
