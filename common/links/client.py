"""Query the links of a running system, and change them."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import zenoh

from common.links.control import (
    LinkControlError,
    LinkReply,
    LiveLinks,
    from_wire,
    to_wire,
)
from common.links.spec import LinkSpec
from common.queries import LINKS

_ANSWER_S = 2.0
_PAUSE_S = 0.2
_SETTLED_S = 1.0


@dataclass(frozen=True)
class Answers:
    """Replies of all services to one query, by service, and the refusals in words."""

    replies: dict[str, LinkReply] = field(default_factory=dict)
    errors: tuple[str, ...] = ()

    @property
    def live(self) -> LiveLinks:
        """The newest live links that any service knows."""
        known = (reply.live for reply in self.replies.values())
        return max(known, key=lambda live: live.version, default=LiveLinks())


def ask(session: Any, robot: str, live: LiveLinks | None = None) -> Answers:
    """Query every service that is connected now, with the ``live`` links to set, if any.

    Raises:
        LinkControlError: the bus does not take the query.
    """
    try:
        replies = session.get(
            LINKS.key(robot, "*"),
            payload=None if live is None else to_wire(live),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ANSWER_S,
        )
        answers = list(replies)
    except zenoh.ZError as error:
        raise LinkControlError(f"cannot ask about links: {error}") from error
    good, errors = {}, []
    for answer in answers:
        if answer.ok is None:
            errors.append(answer.err.payload.to_bytes().decode(errors="replace"))
            continue
        try:
            reply = from_wire(answer.ok.payload.to_bytes(), LinkReply)
        except LinkControlError as error:
            errors.append(f"the answer on {answer.ok.key_expr} is not understood: {error}")
            continue
        good[reply.service] = reply
    return Answers(dict(sorted(good.items())), tuple(errors))


def read_links(session: Any, robot: str, patience_s: float = 6.0) -> Answers:
    """List the links of every service, once the session has found all services.

    A session that has just been opened finds the services one after the other. The query is
    repeated until no further service has turned up for a second.

    Raises:
        LinkControlError: no service answers for ``patience_s``.
    """
    give_up = time.monotonic() + patience_s
    answers, settled_at = Answers(), give_up
    while True:
        latest = ask(session, robot)
        if latest.replies.keys() - answers.replies.keys():
            settled_at = time.monotonic() + _SETTLED_S
        answers = latest if latest.replies else answers
        now = time.monotonic()
        if answers.replies and now >= min(settled_at, give_up):
            return answers
        if now >= give_up:
            raise LinkControlError(
                f"no service of {robot!r} answered in {patience_s:g} s; expected a running system: "
                "start one (trill up), or say where it is (--base-port, --connect, --robot)"
            )
        time.sleep(_PAUSE_S)


def set_links(session: Any, robot: str, links: Mapping[str, LinkSpec]) -> Answers:
    """Set links while the system runs; zero delay switches a link off.

    Raises:
        ConfigError: a name is unknown.
        LinkControlError: no service answers, or the bus does not take the query.
    """
    known = read_links(session, robot).live
    return ask(session, robot, known.with_links(links, time.time_ns()))
