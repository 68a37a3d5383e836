"""Feeds damaged payloads to an inbox, as the transport would, and keeps account."""

import contextlib
import random
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.errors import SchemaError, TrillError
from common.inbox.buffer import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.journal.tables import read_tables
from common.schemas import Message, StepJournal
from common.topics import Delivery, Topic
from common.wire.codec import encode, schema_tag
from verification.fuzz.damage import DAMAGES
from verification.fuzz.messages import random_message

_EXAMPLES = 20
_TAGGED = 0.1
"""Share of payloads that come with a schema tag, mostly a wrong one."""


@dataclass
class Account:
    """What became of the payloads of one topic; ``slowest`` is the longest step [s]."""

    topic: str
    fed: int = 0
    applied: int = 0
    refused: int = 0
    late: int = 0
    slowest: float = 0.0
    by_damage: Counter[str] = field(default_factory=Counter)
    crash: str = ""

    @property
    def exact(self) -> bool:
        """Whether every payload is accounted for and nothing crashed."""
        return not self.crash and self.fed == self.applied + self.refused + self.late


def fuzz_topic(topic: Topic[Any], count: int, seed: int) -> Account:
    """Feed ``count`` payloads to a reader of ``topic``; the same seed, the same payloads."""
    rng = random.Random(f"{topic.name} {seed}")
    account = Account(topic.name)
    inbox = Inbox([topic], context=InboxContext(journal=Journal("fuzz")))
    schema: type[Message] = topic.schema
    own = schema_tag(schema)
    good = [random_message(schema, rng, 0) for _ in range(_EXAMPLES)]
    for number in range(count):
        name = rng.choice(list(DAMAGES))
        message = rng.choice(good)
        header = message.header.model_copy(update={"seq": number})
        payload = DAMAGES[name](encode(message, header), rng)
        tag = rng.choice(["", "trill/X/1;0", own]) if rng.random() < _TAGGED else None
        before = inbox.health_of(topic)
        started = time.perf_counter()
        try:
            inbox.offer(topic.name, payload, number + 1, tag)
            inbox.begin_step(number + 1)
        except Exception as error:  # noqa: BLE001 - finding these is the purpose
            account.crash = f"payload {number} ({name}) {payload[:60]!r}: {error!r}"
            return account
        account.slowest = max(account.slowest, time.perf_counter() - started)
        account.fed += 1
        _note(account, name, inbox, topic, before)
    return account


def _note(account: Account, name: str, inbox: Inbox, topic: Topic[Any], before: Any) -> None:
    """Count what became of the last payload, and look at what a service would now see."""
    after = inbox.health_of(topic)
    account.refused += after.refused - before.refused
    account.by_damage[name] += after.refused - before.refused
    events = inbox.events(topic)
    shown = bool(events) if topic.delivery is Delivery.EVENT else inbox.updated(topic)
    account.applied += shown
    # An event that comes late is shown and counted as late, for it matters all the same.
    if not shown:
        account.late += after.late + after.repeated - before.late - before.repeated
    value = inbox.latest(topic)
    if shown and value is not None:
        _check(value)


def _check(message: Message) -> None:
    """What is shown must be good.

    Raises:
        TrillError: it holds a number that is not finite.
    """
    for name, value in message.__dict__.items():
        bad = isinstance(value, np.ndarray) and not np.isfinite(value).all()
        if bad or (isinstance(value, float) and not np.isfinite(value)):
            raise TrillError(f"{type(message).__name__}.{name} came through as {value}")
    if isinstance(message, StepJournal):
        with contextlib.suppress(SchemaError):
            read_tables(message)
