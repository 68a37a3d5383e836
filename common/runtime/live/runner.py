"""Run one service live: one process, the monotonic clock, Zenoh."""

import gc
import logging
import threading
import time
from collections.abc import Sequence
from typing import Any

from common.errors import EXIT_NAME_TAKEN
from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.journal.journal import Journal
from common.links.config import Links
from common.ports import Role, with_role
from common.runtime.live.clock_sync import ClockSync
from common.runtime.live.components import Component, ComponentSet, RunnerContext
from common.runtime.live.config import RuntimeConfig
from common.runtime.live.heartbeats import Heartbeats
from common.runtime.live.identity import Identity
from common.runtime.live.journal_publisher import JournalPublisher
from common.runtime.live.link_server import LinkServer
from common.runtime.live.loop_stats import LoopStats
from common.runtime.live.pacing import ClockPace, TriggerPace
from common.runtime.live.publishers import PublisherSet
from common.runtime.live.stopping import StopSignals
from common.runtime.service import Service
from common.schemas import ServiceHealth
from common.topics import HEALTH
from common.transport.config import BusConfig
from common.transport.schema_query import SchemaServer
from common.transport.session import BusError, new_boot_id, open_session

_log = logging.getLogger(__name__)

_LONGEST_SLEEP_S = 0.1
"""A signal is handled within this time."""
_HEALTH_PERIOD_NS = 500_000_000
_COLLECT_PERIOD_NS = 1_000_000_000
_LISTENING_S = 0.3
"""A plant listens this long for another one before it publishes anything."""


class LiveRunner:
    """Paces a service, feeds it from the bus and publishes what it returns.

    A service with a trigger is stepped when a message of that topic arrives (see
    :class:`~common.runtime.live.pacing.TriggerPace`), any other on a fixed grid. A step that comes
    too late is not made up for. Cyclic garbage is collected between steps only, once a second.
    """

    def __init__(
        self,
        service: Service,
        bus: BusConfig,
        *,
        links: Links | None = None,
        runtime: RuntimeConfig | None = None,
        realtime: str = "normal",
        components: Sequence[Component] = (),
    ) -> None:
        """Prepare to run ``service``; nothing is opened yet.

        ``links`` are the delays to inject on its inputs; ``realtime`` is the scheduling in force,
        for the health message; ``components`` are the service's own besides those of the runner.
        """
        self._service = service
        self._bus = bus
        self._links = links or Links()
        self._runtime = runtime or RuntimeConfig()
        self._realtime = realtime
        self._stop = StopSignals()
        self._journal = Journal(service.name, service.settings)
        self._stats = LoopStats(service.name, service.period_ns, realtime)
        clocks = ClockSync()
        self._identity = Identity(
            service.name, exclusive=any(topic.exclusive for topic in service.writes), stop=self.stop
        )
        self._components = ComponentSet(
            (
                self._identity,
                JournalPublisher(self._journal),
                clocks,
                Heartbeats(
                    clocks,
                    lambda: self._stats.steps,
                    service.period_ns,
                    service.heartbeat_timeout_s,
                ),
                LinkServer(service.name, self._links),
                *components,
            )
        )
        self.inbox = Inbox(
            service.reads,
            service=service.name,
            links=self._links,
            seed=self._runtime.seed,
            trigger=service.trigger,
            context=InboxContext(clocks.offset_of, time.monotonic_ns, self._journal),
            max_age=self._runtime.max_age,
        )
        self._schemas: SchemaServer | None = None
        self._publishers: PublisherSet
        self._subscribers: list[Any] = []
        self._next_health = self._next_collect = 0
        self._settled = False

    def stop(self) -> None:
        """End :meth:`run` after the current step, from any thread."""
        self._stop.requested = True
        self.inbox.wake()

    def run(self) -> int:
        """Run until :meth:`stop`, SIGINT, SIGTERM, the service ends itself or an error.

        Returns:
            exit code: 0 when stopped, the service's own if it set one, 1 after an error (logged
            with its traceback), :data:`~common.errors.EXIT_NAME_TAKEN` if another is running.
        """
        if threading.current_thread() is threading.main_thread():
            self._stop.install()
        try:
            session: Any = open_session(self._bus, self._service.name, lambda: self._stop.requested)
        except BusError as error:
            _log.error("%s", error)
            self._service.close()
            return 1
        _log.info(
            "%s is on the bus of %s, scheduling: %s",
            self._service.name,
            self._bus.robot,
            self._realtime,
        )
        code = 0
        for topic in self._service.reads:
            spec = self._links.of(self._service.name, topic.name)
            if spec is not None:
                _log.info("%s: input %s has a link of %s", self._service.name, topic.name, spec)
        try:
            self._open_topics(session)
            if self._service.name in with_role(Role.PLANT):
                self._identity.listen(_LISTENING_S)
            self._loop()
            code = self._service.exit_code or 0
            if self._identity.refusal:
                _log.error("%s", self._identity.refusal)
                code = EXIT_NAME_TAKEN
        except Exception:  # noqa: BLE001 - whatever a service raises ends its process
            _log.exception("%s failed", self._service.name)
            code = 1
        finally:
            self._close_topics()
            gc.enable()
            gc.unfreeze()
            try:
                self._service.close()
            finally:
                session.close()
        self._log_delays()
        return code

    def _log_delays(self) -> None:
        """Log the requested and the achieved delay of each link."""
        for name, stats in self.inbox.delay_stats().items():
            _log.info(
                "%s: link of %s: mean %.1f ms requested, %.1f ms drawn, %.1f ms achieved; p99 "
                "%.1f ms requested, %.1f ms achieved; %d of %d lost, %d held back to keep order",
                self._service.name,
                name,
                1e3 * stats.requested_mean,
                1e3 * stats.drawn_mean,
                1e3 * stats.achieved_mean,
                1e3 * stats.requested_p99,
                1e3 * stats.achieved_p99,
                stats.lost,
                stats.pushed,
                stats.held_back,
            )

    def _open_topics(self, session: Any) -> None:
        """Declare publishers, subscribers and queryables."""
        service, robot, boot = self._service, self._bus.robot, new_boot_id()
        own = (HEALTH, *self._components.writes)
        publishers = PublisherSet(
            session, robot, service.name, boot, writes=service.writes, own=own
        )
        self._publishers = publishers
        service.boot, service.wanted = boot, publishers.wanted
        self._subscribers = subscribe(session, robot, self.inbox, service.reads)
        topics = (*service.writes, *own)
        self._schemas = SchemaServer(session, robot, service.name, topics)
        context = RunnerContext(
            session, robot, service.name, boot, self.inbox, publishers.send, publishers.wanted
        )
        for component in self._components.all:
            component.open(context)

    def _close_topics(self) -> None:
        """Close every component, whatever another one raises, and receive no more."""
        for component in self._components.all:
            try:
                component.close()
            except Exception:  # noqa: BLE001 - the session is closed all the same
                _log.exception("%s: %s failed", self._service.name, type(component).__name__)
        if self._schemas is not None:
            self._schemas.close()
        # A session that is closed while messages come in reports each of them as an error.
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _loop(self) -> None:
        """Step until stopped."""
        # Everything loaded so far stays, and so does what the first steps make: a collector that
        # walked through all of it would stop the loop for tens of milliseconds.
        gc.collect()
        gc.freeze()
        gc.disable()
        now = time.monotonic_ns()
        self._next_health = now
        self._next_collect = now + _COLLECT_PERIOD_NS
        period, trigger = self._service.period_ns, self._service.trigger
        if trigger is None:
            self._loop_on_clock(ClockPace(period, now))
        else:
            interval = round(1e9 / trigger.rate) if trigger.rate else period
            self._loop_on_trigger(TriggerPace(period, interval, now))

    def _loop_on_clock(self, pace: ClockPace) -> None:
        while self._sleep_until(pace.due_ns):
            started = time.monotonic_ns()
            self._step(started)
            ended = time.monotonic_ns()
            self._stats.count(ended - started, pace.ended(ended))
            self._between_steps(ended)

    def _loop_on_trigger(self, pace: TriggerPace) -> None:
        inbox = self.inbox
        while not self._stop.requested:
            now = time.monotonic_ns()
            arrival = inbox.trigger_arrival(now)
            if arrival is None or not pace.accepts(arrival):
                if now < pace.due_ns:
                    self._wait_for_trigger(now, min(pace.due_ns, self._components.due_ns))
                    continue
                pace.timed_out(now)
            self._step(now)
            ended = time.monotonic_ns()
            self._stats.count(ended - now, pace.ended(ended, now))
            self._between_steps(ended)

    def _wait_for_trigger(self, now_ns: int, wake_at_ns: int) -> None:
        """Sleep until an arrival, or until one falls due (busy-waiting for the last part)."""
        inbox = self.inbox
        due_ns = inbox.next_trigger_due_ns
        spin_ns = 1000 * self._runtime.spin_us if due_ns <= wake_at_ns else 0
        left = min(due_ns, wake_at_ns) - now_ns - spin_ns
        if left > 0:
            inbox.wait(min(1e-9 * left, _LONGEST_SLEEP_S))
        elif spin_ns:
            time.sleep(0)  # leaves the interpreter to the transport's threads
        self._components.poll(time.monotonic_ns(), only_due=True)

    def _sleep_until(self, due_ns: int) -> bool:
        """Sleep, busy-waiting for the last part; False if the service is to stop."""
        spin_ns = 1000 * self._runtime.spin_us
        while not self._stop.requested:
            now = time.monotonic_ns()
            left = due_ns - now
            if left <= 0:
                return True
            if left > spin_ns:
                rest = min(left, max(self._components.due_ns - now, spin_ns + 1))
                time.sleep(min(1e-9 * (rest - spin_ns), _LONGEST_SLEEP_S))
                self._components.poll(time.monotonic_ns(), only_due=True)
            else:
                time.sleep(0)  # leaves the interpreter to the transport's threads
        return False

    def _step(self, now_ns: int) -> None:
        self.inbox.begin_step(now_ns)
        self._publishers.publish(self._service.step(self.inbox, now_ns), now_ns)
        self._service.after_step()
        self._journal.end_step(time.monotonic_ns())
        if self._service.exit_code is not None:
            self._stop.requested = True

    def _between_steps(self, now_ns: int) -> None:
        """Poll the components, publish health twice a second and collect garbage once."""
        self._components.poll(now_ns)
        if now_ns >= self._next_health:
            self._next_health = max(self._next_health + _HEALTH_PERIOD_NS, now_ns)
            self._publishers.send(HEALTH, self._health())
        elif now_ns >= self._next_collect:
            self._next_collect = now_ns + _COLLECT_PERIOD_NS
            gc.collect()
            if not self._settled:
                self._settled = True
                gc.freeze()

    def _health(self) -> ServiceHealth:
        more: dict[str, Any] = {}
        for component in self._components.all:
            more |= component.report()
        links, outputs = self.inbox.link_health(), self._publishers.health()
        return self._stats.health(links=links, outputs=outputs, **more)
