"""An engine that asks an inference server over the bus; numpy alone.

One request is in flight. Its answer is known by the step that it carries; no clocks are compared.
A server that is killed, stopped, started again or doubled therefore needs no handshake: the next
request goes to whoever is there.
"""

import logging
from collections import deque
from typing import Any

import zenoh

from common.errors import SchemaError
from common.queries import INFERENCE
from common.runtime.live.components import Component, RunnerContext
from common.transport.session import tag_of, wire_encoding
from services.policy.checkpoint.manifest import Description
from services.policy.serving.engine import Answer, Request
from services.policy.serving.wire import REQUEST_TAG, WireFormat

_log = logging.getLogger(__name__)

NO_SERVER = "no inference server is there"
SILENT = "the inference server does not answer"
_Reply = tuple[bytes, str] | str | None
"""An answer with the name of its schema, an error in words, or None: no more replies come."""


class RemoteEngine(Component):
    """Sends requests to the inference servers of its robot, through its service's session.

    Attributes:
        refused: answers that were errors or not understood, so far.
        problem: why there is no answer; empty since the last good one.
        waiting: whether an answer to the last request may still come.
    """

    def __init__(self, description: Description, timeout: float) -> None:
        """Ask for answers of a checkpoint; forget a request after ``timeout`` [s]."""
        self.refused, self.problem, self.waiting = 0, NO_SERVER, False
        self._format = WireFormat(description)
        self._timeout = timeout
        # The transport's threads append: step of the request, and a reply or the end of replies.
        self._arrived: deque[tuple[int, _Reply]] = deque(maxlen=64)
        self._step = -1
        self._replied = False
        self._querier: Any = None
        self._told = NO_SERVER

    def open(self, context: RunnerContext) -> None:
        """Get ready to ask."""
        self._querier = context.session.declare_querier(
            INFERENCE.key(context.robot, "*"),
            # Whoever is first: of two servers one may hang.
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=self._timeout,
            # The robot's loop must not wait for a server that does not read.
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )

    def ask(self, request: Request) -> None:
        """Send a request to all servers."""
        arrived, step = self._arrived, request.step

        def receive(reply: Any) -> None:
            if reply.ok is not None:
                arrived.append((step, (reply.ok.payload.to_bytes(), tag_of(reply.ok.encoding))))
            else:
                arrived.append((step, reply.err.payload.to_bytes().decode(errors="replace")))

        self._step, self._replied, self.waiting = step, False, self._querier is not None
        if self._querier is None:
            return
        try:
            self._querier.get(
                zenoh.handlers.Callback(
                    receive, lambda: arrived.append((step, None)), indirect=False
                ),
                payload=self._format.pack_request(request),
                encoding=wire_encoding(REQUEST_TAG),
            )
        except zenoh.ZError as error:
            self.waiting = False
            self._notice(f"the request was not sent: {error}")

    def work(self) -> None:
        """Nothing: the server computes."""

    def answers(self) -> list[Answer]:
        """Return the answers that came; errors are counted and logged."""
        found = []
        while self._arrived:
            step, reply = self._arrived.popleft()
            if (answer := self._read(step, reply)) is not None:
                found.append(answer)
        return found

    def _read(self, step: int, reply: _Reply) -> Answer | None:
        """Return the answer in a reply; None: it is none."""
        current = step == self._step
        if reply is None:
            # All servers have replied, or gone; without any the transport says so at once.
            if current:
                self.waiting = False
                if not self._replied:
                    self._notice(NO_SERVER)
            return None
        self._replied = self._replied or current
        if isinstance(reply, str):
            self._refuse(reply)
            return None
        try:
            answer = self._format.unpack_answer(*reply)
        except SchemaError as error:
            self._refuse(str(error))
            return None
        self._notice("")
        return answer

    def close(self) -> None:
        """Ask no more; the session must still be open."""
        if self._querier is not None:
            self._querier.undeclare()
            self._querier = None

    def _refuse(self, reason: str) -> None:
        """Count an answer that is none, unless it is the transport's word that none came."""
        if reason.lower() == "timeout":
            self._notice(SILENT)
            return
        self.refused += 1
        self._notice(reason)

    def _notice(self, problem: str) -> None:
        """Keep a problem; log it once, also if good answers of another server come between."""
        absent = {NO_SERVER, SILENT}
        if not problem and self.problem in absent:
            _log.info("answers come")
            self._told = ""
        elif problem and problem != self._told:
            _log.warning("%s", problem)
            self._told = problem
        self.problem = problem
