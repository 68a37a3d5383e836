"""The far side of remote inference: takes requests from the bus and answers the newest."""

import logging
import queue
import time
from typing import Any

import zenoh

from common.errors import SchemaError
from common.queries import INFERENCE
from common.transport.session import tag_of, wire_encoding
from services.policy.checkpoint.manifest import Description
from services.policy.serving.engine import Answer, Runtime
from services.policy.serving.wire import ANSWER_TAG, WireFormat

_log = logging.getLogger(__name__)


class InferenceServer:
    """Answers the requests of one robot's policy, one at a time.

    Attributes:
        seconds: times that the last answers took [s].
        refused: requests that were not understood.
        skipped: requests that were overtaken by a newer one before they were looked at.
    """

    def __init__(
        self, session: "zenoh.Session", robot: str, runtime: Runtime, description: Description
    ) -> None:
        """Begin to take requests."""
        self.seconds: list[float] = []
        self.refused = self.skipped = 0
        self._told = ""
        self._runtime = runtime
        self._format = WireFormat(description)
        self._key = INFERENCE.key(robot, str(session.info.zid()))
        self._queries: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._queryable: Any = session.declare_queryable(self._key, self._queries.put)

    def serve(self, timeout: float) -> bool:
        """Answer the newest request, waiting ``timeout`` [s] for one; returns whether there was.

        Older ones that wait are dropped: after a stop of this process nobody wants them any more.
        """
        try:
            query = self._queries.get(timeout=timeout)
            while not self._queries.empty():
                newer = self._queries.get()
                query.drop()
                query, self.skipped = newer, self.skipped + 1
        except queue.Empty:
            return False
        with query:
            try:
                answer = self._answer(query)
            except SchemaError as error:
                self.refused += 1
                if str(error) != self._told:
                    self._told = str(error)
                    _log.warning("refused: %s", error)
                query.reply_err(str(error).encode())
                return True
            query.reply(
                self._key,
                self._format.pack_answer(answer),
                encoding=wire_encoding(ANSWER_TAG),
                express=True,
            )
        return True

    def close(self) -> None:
        """Take no more requests; the session must still be open."""
        self._queryable.undeclare()

    def _answer(self, query: Any) -> Answer:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        request = self._format.unpack_request(payload, tag_of(query.encoding))
        began = time.perf_counter()
        decision, memory = self._runtime.run(*request[1:])
        seconds = time.perf_counter() - began
        self.seconds.append(seconds)
        return Answer(request.step, decision, memory, seconds)
