"""Asking the services of a running system about their links, and changing them."""

import time
from dataclasses import dataclass, field
from typing import Any

import zenoh

from common.links.control import (
    LinkControlError,
    LinkReply,
    LinkRequest,
    from_wire,
    links_key,
    to_wire,
)
from common.links.spec import LinkSpec

_ANSWER_S = 2.0
_PAUSE_S = 0.2
_SETTLED_S = 1.0


@dataclass(frozen=True)
class Answers:
    """What the services said.

    Attributes:
        replies: of those that did as asked, by name.
        errors: of the others, in words.
    """

    replies: dict[str, LinkReply] = field(default_factory=dict)
    errors: tuple[str, ...] = ()

    @property
    def version(self) -> int:
        """Of the newest live change anybody knows; -1 if there is none."""
        known = [entry.version for reply in self.replies.values() for entry in reply.live]
        return max(known, default=-1)


def ask(session: Any, robot: str, request: LinkRequest) -> Answers:
    """Send one request to every service that is connected now, and wait for the answers.

    Raises:
        LinkControlError: the bus does not take the request, or it is too long.
    """
    payload = to_wire(request)
    from_wire(payload, LinkRequest)
    try:
        replies = session.get(
            links_key(robot, "*"),
            payload=payload,
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
            errors.append(f"{answer.ok.key_expr} answered what is not understood: {error}")
            continue
        good[reply.service] = reply
    return Answers(dict(sorted(good.items())), tuple(errors))


def everybody(session: Any, robot: str, patience_s: float = 6.0) -> Answers:
    """List the links of every service, once the session has found them all.

    A session that has just been opened finds the services one after the other, so it is asked
    until no further one has turned up for a second.

    Raises:
        LinkControlError: nobody answers for ``patience_s``.
    """
    give_up = time.monotonic() + patience_s
    answers, settled_at = Answers(), give_up
    while True:
        now_there = ask(session, robot, LinkRequest(action="list"))
        if now_there.replies.keys() - answers.replies.keys():
            settled_at = time.monotonic() + _SETTLED_S
        answers = now_there if now_there.replies else answers
        now = time.monotonic()
        if answers.replies and now >= min(settled_at, give_up):
            return answers
        if now >= give_up:
            raise LinkControlError(
                f"no service of {robot!r} answered in {patience_s:g} s; expected a running system: "
                "start one (trill up), or say where it is (--base-port, --connect, --robot)"
            )
        time.sleep(_PAUSE_S)


def change(session: Any, robot: str, links: dict[str, LinkSpec | None] | None) -> Answers:
    """Set links while the system runs; None clears all.

    Raises:
        LinkControlError: nobody answers, or the bus does not take the request.
    """
    known = everybody(session, robot)
    version = max(time.time_ns(), known.version + 1)
    if links is None:
        return ask(session, robot, LinkRequest(action="clear", version=version))
    return ask(session, robot, LinkRequest(action="set", links=links, version=version))
