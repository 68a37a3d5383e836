"""One service in simulated time, with what its process would hold: inbox, journal, counters."""

from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.links.config import Links
from common.runtime.service import Service
from common.runtime.simulated.bus import SimBus
from common.topics import JOURNAL, LINK_CHANGE
from common.wire.stamper import HeaderStamper


class Host:
    """A service that a runner steps.

    Attributes:
        service: the service.
        order: its place among those due at the same time.
        paused: whether it is not stepped.
        inbox: its inputs.
        journal: records what its steps take in; None: nothing does.
        journal_due: when the journal is published next [ns].
        stampers: counters of its publishers, by name of the topic.
    """

    inbox: Inbox

    def __init__(self, service: Service, order: int) -> None:
        self.service = service
        self.order = order
        self.paused = False
        self.journal: Journal | None = None
        self.journal_due = 0
        self.stampers: dict[str, HeaderStamper] = {}
        self._runs = 0

    def start(self, bus: SimBus, links: Links, seed: int, *, journal: bool) -> None:
        """Start a run of the service: empty inbox, new boot id, counters at 0.

        Args:
            bus: tells what is wanted, and boot ids.
            links: delays to inject.
            seed: of links without their own.
            journal: whether to record what the steps take in.
        """
        service = self.service
        service.wanted = bus.wanted
        self._runs += 1
        service.boot = bus.boot(service.name, self._runs)
        self.journal = Journal(service.name, service.settings) if journal else None
        self.inbox = Inbox(
            service.reads,
            service=service.name,
            links=links,
            seed=seed,
            context=InboxContext(journal=self.journal),
        )
        writes = (*service.writes, LINK_CHANGE, *((JOURNAL,) if journal else ()))
        self.stampers = {topic.name: bus.stamper(service.name, self._runs) for topic in writes}
