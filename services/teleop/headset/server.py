"""Web server of the page: one port and one origin for files, poses and pictures."""

import asyncio
import json
import os
import ssl
import threading
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import WSCloseCode, WSMsgType, web

from services.teleop.errors import TeleopError
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.credentials import Credentials
from services.teleop.headset.hub import Event, Hub, Picture
from services.teleop.headset.protocol import (
    LARGEST_MESSAGE,
    ProtocolError,
    Shown,
    parse,
    picture_message,
)

PAGE = Path(__file__).parent / "page"
WINDOW = 2
"""Pictures on their way to a page that it has not drawn yet."""
HEARTBEAT = 2.0
"""Time between two pings of the connection; without an answer it is closed [s]."""
RATE = 300.0
"""Largest number of messages of a page in a second; headsets have up to 120 frames."""
PATIENCE = 50
"""Messages that are refused before a page is sent away."""
START_TIMEOUT = 10.0
GOODBYE_TIMEOUT = 1.0
"""Time for pages to answer that they are closed [s]."""
LOWEST_PRIORITY = 1
"""Of real-time scheduling."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class WebServer:
    """Serves the page in a thread of its own until it is closed.

    Attributes:
        port: it listens on; known once it has started.
    """

    def __init__(self, config: HeadsetConfig, credentials: Credentials, hub: Hub) -> None:
        self.port = config.port
        self._config, self._credentials, self._hub = config, credentials, hub
        self._loop = asyncio.new_event_loop()
        self._connections: set[_Connection] = set()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._runner: web.AppRunner | None = None

    def start(self) -> None:
        """Listen.

        Raises:
            TeleopError: the address or the port cannot be used.
        """
        self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self._listen(), self._loop).result(START_TIMEOUT)
        except OSError as error:
            self.close()
            raise TeleopError(
                f"cannot serve the page at {self._config.address} port {self._config.port}: "
                f"{error.strerror or error}; choose another one: --port or [headset] port, "
                "--address or [headset] address"
            ) from error
        self._hub.notify = self._notify

    def close(self) -> None:
        """Close every connection and end the thread."""
        if not self._thread.is_alive():
            return
        with suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(self._stop(), self._loop).result(START_TIMEOUT)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(START_TIMEOUT)
        self._loop.close()

    def _run(self) -> None:
        # Below the loops that balance the robot, but above everything else: whoever is not let run
        # while it has the interpreter's lock holds up the operator's loop.
        if os.sched_getscheduler(0) == os.SCHED_FIFO:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOWEST_PRIORITY))
        self._loop.run_forever()

    async def _listen(self) -> None:
        app = web.Application()
        app.on_response_prepare.append(_add_headers)
        app.router.add_get("/", _index)
        app.router.add_get("/socket", self._socket)
        app.router.add_post("/socket", self._check)
        app.router.add_static("/", PAGE)
        # No access log: it would hold the token.
        self._runner = web.AppRunner(
            app, access_log=None, handler_cancellation=True, shutdown_timeout=GOODBYE_TIMEOUT
        )
        await self._runner.setup()
        context: ssl.SSLContext | None = self._credentials.context
        site = web.TCPSite(
            self._runner, self._config.address, self._config.port, ssl_context=context
        )
        await site.start()
        self.port = self._runner.addresses[0][1]

    async def _stop(self) -> None:
        goodbyes = [
            connection.socket.close(code=WSCloseCode.GOING_AWAY) for connection in self._connections
        ]
        with suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_TIMEOUT):
                await asyncio.gather(*goodbyes, return_exceptions=True)
        if self._runner is not None:
            await self._runner.cleanup()

    def _notify(self) -> None:
        # The loop may have been closed since.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for connection in self._connections:
            connection.news.set()

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        self._admit(request)
        socket = web.WebSocketResponse(
            max_msg_size=LARGEST_MESSAGE, heartbeat=HEARTBEAT, compress=False
        )
        await socket.prepare(request)
        connection = _Connection(socket, self._hub)
        self._connections.add(connection)
        try:
            await connection.run()
        finally:
            self._connections.discard(connection)
            self._hub.put(Event(connection.page, None, time.monotonic_ns()))
        return socket

    async def _check(self, request: web.Request) -> web.StreamResponse:
        """Say why a page is not let in, which browsers do not tell it of a refused WebSocket."""
        self._admit(request)
        return web.Response(status=204)

    def _admit(self, request: web.Request) -> None:
        """Let only our own page in, with the token.

        Raises:
            HTTPException: says why not.
        """
        refusals, origin = self._hub.refusals, request.headers.get("Origin", "")
        if not self._is_own(origin):
            refusals.origin += 1
            raise web.HTTPForbidden(
                text=f"origin {origin[:100]!r} is not this page; open the link that was printed, "
                "or name this host by [headset] names"
            )
        if not self._credentials.admits(request.query.get("token", "")):
            refusals.token += 1
            raise web.HTTPUnauthorized(text="wrong token; open the link that was printed")
        if len(self._connections) >= self._config.pages:
            refusals.pages += 1
            raise web.HTTPServiceUnavailable(
                text=f"{self._config.pages} pages are open already; close one, or raise "
                "[headset] pages"
            )

    def _is_own(self, origin: str) -> bool:
        try:
            parts = urlsplit(origin)
            port = parts.port
        except ValueError:
            return False
        scheme, usual = ("https", 443) if self._config.secure else ("http", 80)
        return (parts.scheme, port or usual) == (scheme, self.port) and (
            parts.hostname in {name.lower() for name in self._credentials.names}
        )


class _Connection:
    """One open page."""

    def __init__(self, socket: web.WebSocketResponse, hub: Hub) -> None:
        self.socket, self.news, self.page = socket, asyncio.Event(), hub.new_page()
        self._hub = hub
        self._under_way = 0
        self._allowance, self._refilled = RATE, time.monotonic()
        self._refused = 0

    async def run(self) -> None:
        """Exchange messages until the page goes or is sent away."""
        sender = asyncio.ensure_future(self._send())
        try:
            async for message in self.socket:
                if message.type is WSMsgType.TEXT:
                    await self._receive(message.data)
                elif message.type is WSMsgType.BINARY:
                    await self._refuse("garbage")
                elif message.type is WSMsgType.ERROR:
                    # The connection is closed by then.
                    await self._refuse(_kind_of(message.data))
        finally:
            sender.cancel()
            with suppress(asyncio.CancelledError, ConnectionError):
                await sender

    async def _receive(self, text: str) -> None:
        arrival_ns = time.monotonic_ns()
        if not self._within_rate():
            await self._refuse("flood")
            return
        try:
            message = parse(text)
        except ProtocolError:
            await self._refuse("garbage")
            return
        if isinstance(message, Shown):
            self._under_way = max(0, self._under_way - 1)
            self.news.set()
        self._hub.put(Event(self.page, message, arrival_ns))

    def _within_rate(self) -> bool:
        now = time.monotonic()
        self._allowance = min(RATE, self._allowance + RATE * (now - self._refilled))
        self._refilled = now
        if self._allowance < 1.0:
            return False
        self._allowance -= 1.0
        return True

    async def _refuse(self, kind: str) -> None:
        refusals = self._hub.refusals
        setattr(refusals, kind, getattr(refusals, kind) + 1)
        self._refused += 1
        if self._refused > PATIENCE:
            await self.socket.close(
                code=WSCloseCode.POLICY_VIOLATION, message=f"too many refusals: {kind}".encode()
            )

    async def _send(self) -> None:
        """Send status and pictures, the latest only, as fast as the page takes them."""
        told: object = None
        drawn = 0
        while True:
            status = self._hub.status
            if status and status is not told:
                told = status
                reply = self._hub.replies.get(self.page, {})
                await self.socket.send_str(json.dumps({**status, "you": reply}))
            picture = self._hub.picture
            if picture and picture.number != drawn and self._under_way < WINDOW:
                drawn = picture.number
                self._under_way += 1
                await self.socket.send_bytes(_encoded(picture))
            await self.news.wait()
            self.news.clear()


def _kind_of(error: object) -> str:
    """Return under which name an error of the connection is counted."""
    too_big = getattr(error, "code", None) == WSCloseCode.MESSAGE_TOO_BIG
    return "oversized" if too_big else "garbage"


def _encoded(picture: Picture) -> bytes:
    waited = 1e-9 * (time.monotonic_ns() - picture.at_ns)
    header = {
        "number": picture.number,
        "stamp": picture.stamp,
        "neck": round(picture.neck, 5),
        "age": round(1e3 * (picture.age + waited), 2),
    }
    return picture_message(header, picture.left, picture.right)


async def _index(_request: web.Request) -> web.StreamResponse:
    return web.FileResponse(PAGE / "index.html")


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)
