"""Live links of services in simulated time."""

from common.errors import TrillError
from common.inbox.inbox import Inbox
from common.links.config import LinkName, Links, checked_spec
from common.links.control import LiveLinks
from common.links.spec import LinkSpec
from common.runtime.inbox_links import InboxLinks
from common.schemas import LinkChange


class SimLinks:
    """Keeps the live links beyond the restart of a service, as live services do for each other."""

    def __init__(self, configured: Links) -> None:
        """Begin with what was configured."""
        self._configured = configured
        self._live = LiveLinks()
        self._services: dict[str, InboxLinks] = {}

    def begin(self, service: str, inbox: Inbox) -> list[LinkChange]:
        """Put the live links on the new inbox of a service that starts; return the changes."""
        links = InboxLinks(service, self._configured, inbox)
        self._services[service] = links
        return [*links.initial(), *links.apply(self._live, "peer")]

    def set(self, name: str, spec: str | LinkSpec | None) -> list[LinkChange]:
        """Set the links called ``name`` from now on and return the changes.

        Raises:
            ConfigError: name or specification is wrong.
            TrillError: no service reads what is named.
        """
        live = self._live.with_links(
            {name: LinkSpec() if spec is None else checked_spec(name, spec)}, now_ns=0
        )
        parsed = LinkName.parse(name)
        if not any(links.reads(parsed) for links in self._services.values()):
            raise TrillError(
                f"no input is called {name!r}; expected a topic or alias that one of "
                f"{', '.join(self._services)} reads"
            )
        self._live = live
        return [
            change for links in self._services.values() for change in links.apply(live, "request")
        ]
