"""The links in force on the inputs of one service, the same live and in simulated time."""

from common.inbox.inbox import Inbox
from common.links.config import LinkName, Links
from common.links.control import LinkRow, LiveLinks
from common.links.spec import LinkSpec
from common.schemas import LinkChange

_MAX_TEXT = 200


class InboxLinks:
    """Puts live links on a service's inbox and reports every change as a message."""

    def __init__(self, service: str, configured: Links, inbox: Inbox) -> None:
        """Begin with the links that were configured, which ``inbox`` was made with."""
        self.live = LiveLinks()
        self._service, self._configured, self._inbox = service, configured, inbox

    def reads(self, name: LinkName) -> bool:
        """Return whether one of the service's inputs has that name."""
        return any(name.covers(self._service, topic) for topic in self._inbox.topics)

    def rows(self) -> list[LinkRow]:
        """Describe every input, with what its link has done so far."""
        inbox, stats = self._inbox, self._inbox.delay_stats()
        links = {topic: inbox.link_of(topic) for topic in inbox.topics}
        return [
            LinkRow(topic=topic, link=link, delays=stats.get(topic) if link else None)
            for topic, link in links.items()
        ]

    def initial(self) -> list[LinkChange]:
        """Return a change with reason ``start`` for each input that has a link now."""
        return [
            self._change(topic, link, "", "start")
            for topic in self._inbox.topics
            if (link := self._inbox.link_of(topic))
        ]

    def apply(self, live: LiveLinks, reason: str) -> list[LinkChange]:
        """Put newer live links in force and return the changes of inputs; ignore older ones.

        Args:
            live: the document.
            reason: ``request`` or ``peer``, for the changes.
        """
        if live.version <= self.live.version:
            return []
        self.live = live
        inbox, links = self._inbox, live.over(self._configured)
        changes = []
        for topic in inbox.topics:
            spec = links.of(self._service, topic) or LinkSpec()
            # The texts would not do: those of two traces of one length are alike.
            if spec == inbox.spec_of(topic):
                continue
            previous = inbox.link_of(topic)
            inbox.set_link(topic, spec)
            changes.append(self._change(topic, inbox.link_of(topic), previous, reason))
        return changes

    def _change(self, topic: str, link: str, previous: str, reason: str) -> LinkChange:
        return LinkChange(
            service=self._service,
            topic=topic,
            link=link[:_MAX_TEXT],
            previous=previous[:_MAX_TEXT],
            reason=reason,
        )
