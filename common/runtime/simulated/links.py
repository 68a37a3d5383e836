"""Links of simulated services: what was configured, and what was set at a virtual time."""

from collections.abc import Mapping

from common.errors import TrillError
from common.inbox.inbox import Inbox
from common.links.config import Links, checked_spec
from common.links.control import LinkRequest, LinkTable
from common.links.spec import LinkSpec
from common.schemas import LinkChange


class SimLinks:
    """Keeps each service's links over its lives, as the live services keep each other's."""

    def __init__(self, links: Links) -> None:
        """Start with what was configured."""
        self._links = links
        self._tables: dict[str, LinkTable] = {}
        self._changes = 0

    def begin(self, service: str, inbox: Inbox) -> list[LinkChange]:
        """A life of ``service`` begins: put its links on its new inbox; what is to be told."""
        table = self._tables.setdefault(service, LinkTable(service, self._links))
        told = []
        for topic in inbox.topics:
            if link := inbox.link_of(topic):
                told.append(_change(service, topic, link, "", "start"))
            told += self._put(table, service, inbox, topic, "peer")
        return told

    def set(
        self,
        name: str,
        spec: str | LinkSpec | None,
        inboxes: Mapping[str, Inbox],
        service: str | None = None,
    ) -> list[LinkChange]:
        """Change the links called ``name`` from now on, for one service or all.

        Raises:
            ConfigError: name or specification is wrong.
            TrillError: no input of these services has that name.
        """
        checked = None if spec is None else checked_spec(name, spec)
        full = f"{service}:{name}" if service is not None else name
        request = LinkRequest(action="set", links={full: checked}, version=self._changes)
        concerned = {
            host: self._tables[host].concerned(request, inbox.topics)
            for host, inbox in inboxes.items()
        }
        if not any(concerned.values()):
            raise TrillError(
                f"no input is called {full!r}; expected a topic or short name that one of "
                f"{', '.join(inboxes)} reads"
            )
        self._changes += 1
        told = []
        for host, inbox in inboxes.items():
            self._tables[host].apply(request, 0)
            for topic in concerned[host]:
                told += self._put(self._tables[host], host, inbox, topic, "request")
        return told

    @staticmethod
    def _put(
        table: LinkTable, service: str, inbox: Inbox, topic: str, reason: str
    ) -> list[LinkChange]:
        """Put what the table says on an input, if it is not there yet."""
        spec = table.of(topic)
        previous = inbox.link_of(topic)
        # Not in words: in these, two traces of one length are alike.
        if (spec or LinkSpec()) == inbox.spec_of(topic):
            return []
        inbox.set_link(topic, spec)
        return [_change(service, topic, inbox.link_of(topic), previous, reason)]


def _change(service: str, topic: str, link: str, previous: str, reason: str) -> LinkChange:
    return LinkChange(
        service=service, topic=topic, link=link[:200], previous=previous[:200], reason=reason
    )
