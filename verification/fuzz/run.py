"""Feed damaged payloads to an inbox as the transport does, and count what becomes of them."""

import contextlib
import random
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.errors import SchemaError, TrillError
from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.journal.tables import read_tables
from common.schemas import Message, StepJournal
from common.topics import Delivery, Topic
from common.wire.codec import encode, schema_tag
from verification.fuzz.damage import DAMAGES
from verification.fuzz.strategies import corpus

_MESSAGES = 30
"""Valid messages per topic that are damaged again and again."""
_TAGGED = 0.1
"""Share of payloads that come with a schema tag, mostly a wrong one."""


@dataclass
class FuzzResult:
    """What became of the payloads of one topic.

    ``late`` are the overtaken and repeated ones, and those whose damage made another sender of
    them; ``slowest`` is the longest step [s].
    """

    topic: str
    fed: int = 0
    applied: int = 0
    refused: int = 0
    late: int = 0
    slowest: float = 0.0
    refused_by_damage: Counter[str] = field(default_factory=Counter)
    crash: str = ""

    @property
    def complete(self) -> bool:
        """Whether every payload is accounted for and nothing crashed."""
        return not self.crash and self.fed == self.applied + self.refused + self.late


def fuzz_topic(topic: Topic[Any], count: int, seed: int) -> FuzzResult:
    """Feed ``count`` payloads to a reader of ``topic``; the same seed gives the same payloads.

    Raises:
        TrillError: a number that is not finite reached the service.
    """
    rng = random.Random(f"{topic.name} {seed}")
    result = FuzzResult(topic.name)
    inbox = Inbox([topic], context=InboxContext(journal=Journal("fuzz")))
    schema: type[Message] = topic.schema
    messages, names = corpus(schema, _MESSAGES, seed), list(DAMAGES)
    for number in range(count):
        name, message = rng.choice(names), rng.choice(messages)
        # Sequence numbers and boot as of one publisher, so that good messages are applied.
        header = message.header.model_copy(update={"seq": number, "boot": 1, "source": "fuzz"})
        payload = DAMAGES[name](encode(message, header), rng)
        tag = (
            rng.choice(["", "trill/X/1;0", schema_tag(schema)]) if rng.random() < _TAGGED else None
        )
        before, started = inbox.health_of(topic), time.perf_counter()
        try:
            inbox.offer(topic.name, payload, number + 1, tag)
            inbox.begin_step(number + 1)
        except Exception as error:  # noqa: BLE001 - finding these is the purpose
            result.crash = f"payload {number} ({name}) {payload[:60]!r}: {error!r}"
            return result
        result.slowest = max(result.slowest, time.perf_counter() - started)
        result.fed += 1
        after = inbox.health_of(topic)
        result.refused += after.refused - before.refused
        result.refused_by_damage[name] += after.refused - before.refused
        is_event = topic.delivery is Delivery.EVENT
        if bool(inbox.events(topic)) if is_event else inbox.updated(topic):
            result.applied += 1
            _check(inbox.latest(topic))
        else:
            # A late event is applied and counted as late; it must not be counted twice.
            result.late += after.late + after.repeated - before.late - before.repeated
            result.late += after.foreign - before.foreign
    return result


def _check(message: Message | None) -> None:
    """Check the message that the service would see.

    Raises:
        TrillError: it holds a number that is not finite.
    """
    for name, value in () if message is None else message.__dict__.items():
        if isinstance(value, float | np.ndarray) and not np.isfinite(value).all():
            raise TrillError(f"{type(message).__name__}.{name} came through as {value}")
    if isinstance(message, StepJournal):
        with contextlib.suppress(SchemaError):
            read_tables(message)
