"""Run services in one process on a virtual clock: deterministic, faster than real time.

The clock starts at 0. A service is stepped at ``offset + k * period``, whatever its trigger;
services due at the same time are stepped in the order of the list. A message published at time t
has arrived at t (or later, by its link's delay): a service further down the list gets it at the
same t, one further up at its next step. Every message goes through the same codec and the same
inbox and delay lines as on the live bus, so what a service is given differs only in time. Two runs
with the same services, seed and calls are equal byte by byte, provided that no service looks at a
wall clock or draws unseeded random numbers.
"""

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from heapq import heapify, heappop, heappush
from types import TracebackType
from typing import Any, Self, TypeVar

from common.errors import TrillError
from common.inbox.inbox import Inbox
from common.journal.journal import PERIOD_NS as JOURNAL_PERIOD_NS
from common.journal.journal import Journal
from common.links.config import Links
from common.links.spec import LinkSpec
from common.runtime.service import Service
from common.runtime.simulated.bus import SimBus
from common.runtime.simulated.host import Host
from common.runtime.simulated.links import SimLinks
from common.schemas import LinkChange, Message
from common.topics import JOURNAL, LINK_CHANGE, Topic
from common.transport.tap import RawSample
from common.wire.stamper import HeaderStamper

M = TypeVar("M", bound=Message)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Keep the garbage collector from looking for cycles, of which steps leave none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class SimTimeRunner:
    """Hosts services on a virtual clock; see the module for the rules of time."""

    def __init__(
        self,
        services: Sequence[Service],
        seed: int = 0,
        links: Links | Mapping[str, str | LinkSpec] | None = None,
        *,
        offsets_ns: Mapping[str, int] | None = None,
        robot: str = "draco3",
        record: bool = False,
        journal: bool | None = None,
    ) -> None:
        """Prepare; no service is stepped yet.

        Args:
            services: what to run; their order decides at equal times.
            seed: of boot ids and of links without their own seed.
            links: delays by name, see :mod:`common.links.config`.
            offsets_ns: time of the first step by service name; 0 where not named.
            robot: first part of the keys in the record.
            record: keep every message in :attr:`log`, also those without a reader.
            journal: publish each service's :class:`~common.schemas.StepJournal`, so that it can
                be replayed; None: when recording.

        Raises:
            TrillError: two services have the same name, or an offset names none.
            ConfigError: a link is wrong.
        """
        self._now = 0
        self._seed = seed
        self._bus = SimBus(lambda: self._now, seed=seed, robot=robot, record=record)
        self._journal = record if journal is None else journal
        names = [service.name for service in services]
        self._links = links if isinstance(links, Links) else Links.from_table(links or {}, names)
        self._set_links = SimLinks(self._links)
        self._pending_changes: list[LinkChange] = []
        self._hosts = {service.name: Host(service, i) for i, service in enumerate(services)}
        offsets = dict(offsets_ns or {})
        unknown = offsets.keys() - self._hosts.keys()
        if len(self._hosts) != len(services) or unknown:
            raise TrillError(
                f"expected services of different names and offsets of these only; got "
                f"{names} and offsets of {sorted(offsets)}"
            )
        self._injectors: dict[tuple[str, str], HeaderStamper] = {}
        for host in self._hosts.values():
            self._start(host)
        self._connect()
        self._queue = [
            (offsets.get(name, 0), host.order, host) for name, host in self._hosts.items()
        ]
        heapify(self._queue)

    @property
    def now_ns(self) -> int:
        """The virtual clock [ns]."""
        return self._now

    @property
    def log(self) -> list[RawSample]:
        """Every message so far, if recording."""
        return self._bus.log

    def run_until(self, t_ns: int) -> None:
        """Run every step due before ``t_ns``; the clock then stands at ``t_ns``."""
        self._publish_changes()
        queue = self._queue
        with _uncollected():
            while queue and queue[0][0] < t_ns:
                self._now, order, host = heappop(queue)
                try:
                    if not host.paused:
                        self._step(host, t_ns)
                finally:
                    # A step that raises does not come again either.
                    heappush(queue, (self._now + host.service.period_ns, order, host))
        self._now = max(self._now, t_ns)

    def run_for(self, seconds: float) -> None:
        """Run for a duration of virtual time [s]."""
        self.run_until(self._now + round(seconds * 1e9))

    def inject(self, topic: Topic[M], message: M, source: str = "inject") -> None:
        """Publish ``message`` now, as a service called ``source`` would."""
        stamper = self._injectors.get((source, topic.name))
        if stamper is None:
            stamper = self._bus.stamper(source, 0)
            self._injectors[source, topic.name] = stamper
        self._bus.send(stamper, source, topic, message)

    def set_link(
        self, name: str, spec: str | LinkSpec | None, service: str | None = None
    ) -> list[LinkChange]:
        """Change links from now on, as ``trill latency set`` does; None: no delay any more.

        Args:
            name: a topic or an alias, see :mod:`common.links.config`.
            spec: what to inject.
            service: the only consumer meant; None: every one.

        Returns:
            each change made, as it was published.

        Raises:
            ConfigError: name or specification is wrong.
            TrillError: no service reads what is named.
        """
        full = name if service is None else f"{service}:{name}"
        changes = self._set_links.set(full, spec)
        self._pending_changes += changes
        self._publish_changes()
        return changes

    def pause_service(self, name: str) -> None:
        """Stop stepping a service, as if its process were stopped; its inbox still fills."""
        self._host(name).paused = True

    def resume_service(self, name: str) -> None:
        """Step a paused service again, on its old grid."""
        self._host(name).paused = False

    def replace_service(self, name: str, new: Service) -> None:
        """Restart a service: ``new`` takes its place with an empty inbox and a new boot id.

        Raises:
            TrillError: there is no such service, or ``new`` has another name.
        """
        host = self._host(name)
        if new.name != name:
            raise TrillError(f"expected a service named {name!r} to replace it, got {new.name!r}")
        host.service.close()
        host.service = new
        host.paused = False
        self._start(host)
        self._connect()

    def on_message(self, topic: Topic[M], callback: Callable[[M], None]) -> None:
        """Call ``callback`` with every message of ``topic``, decoded, when it is published."""
        self._bus.on_message(topic, callback)

    def newest(self, topic: Topic[M]) -> Callable[[], M | None]:
        """Return a function that gives the newest message of ``topic``; None: there is none yet.

        For whoever needs few of the messages: only those asked for are decoded.
        """
        return self._bus.newest(topic)

    def inbox(self, name: str) -> Inbox:
        """The inbox of a service, e.g. for its counters."""
        return self._host(name).inbox

    def digest(self) -> str:
        """Return the SHA-256 over time, key and payload of everything in :attr:`log`."""
        return self._bus.digest()

    def close(self) -> None:
        """Close every service."""
        for host in self._hosts.values():
            host.service.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _step(self, host: Host, t_ns: int) -> None:
        """Step a service now, and perhaps on before ``t_ns``; the clock is then at its last step.

        Both are what it would do if it were stepped on its own: nothing happens in between.
        """
        service, inbox, journal = host.service, host.inbox, host.journal
        begun, period = self._now, service.period_ns
        inbox.begin_step(begun)
        self._now, outputs = service.step_until(inbox, begun, self._alone_until(host, t_ns))
        if journal is not None:
            for quiet in range(begun, self._now, period):
                journal.end_step(quiet)
                journal.begin_step(quiet + period)
        for output in outputs:
            self._publish(host, output.topic, output.message)
        service.after_step()
        if journal is not None:
            self._end_journal_step(host, journal)
        # A service that has ended itself is stepped no more, like a process that is gone.
        host.paused = service.exit_code is not None

    def _alone_until(self, host: Host, t_ns: int) -> int:
        """Return the time, at most ``t_ns``, before which only ``host`` acts and no input comes."""
        if self._queue:
            due, order, _ = self._queue[0]
            # At equal times the order of the list decides.
            t_ns = min(t_ns, due + (host.order < order))
        if (release_ns := host.inbox.next_release_ns()) is not None:
            t_ns = min(t_ns, release_ns)
        if host.journal is not None:
            # The first step from then on publishes it.
            t_ns = min(t_ns, max(self._now, host.journal_due) + host.service.period_ns)
        return t_ns

    def _end_journal_step(self, host: Host, journal: Journal) -> None:
        """End a step in the journal; publish it if it is time, or the service has ended."""
        journal.end_step(self._now)
        if self._now >= host.journal_due or host.service.exit_code is not None:
            host.journal_due = self._now + JOURNAL_PERIOD_NS
            message = journal.fetch()
            if message is not None:
                self._publish(host, JOURNAL, message)

    def _publish(self, host: Host, topic: Topic[Any], message: Message) -> None:
        """Send an output of a service."""
        stamper = host.stampers.get(topic.name)
        if stamper is None:
            raise TrillError(
                f"{host.service.name} published {topic.name!r}; expected one of its `writes`: "
                f"{', '.join(t.name for t in host.service.writes) or 'none'}"
            )
        self._bus.send(stamper, host.service.name, topic, message, own=host.inbox)

    def _publish_changes(self) -> None:
        """Publish changes of links that are pending."""
        changes, self._pending_changes = self._pending_changes, []
        for change in changes:
            self._publish(self._host(change.service), LINK_CHANGE, change)

    def _start(self, host: Host) -> None:
        """Start a run of a service, which sets its links."""
        host.start(self._bus, self._links, self._seed, journal=self._journal)
        self._pending_changes += self._set_links.begin(host.service.name, host.inbox)

    def _connect(self) -> None:
        """Deliver to the services' inboxes, in the order of the services."""
        self._bus.connect(host.inbox for host in self._hosts.values())

    def _host(self, name: str) -> Host:
        host = self._hosts.get(name)
        if host is None:
            raise TrillError(f"no service {name!r}; expected one of {', '.join(self._hosts)}")
        return host
