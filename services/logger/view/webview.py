"""Serves a recording with Rerun's web viewer on this machine only, from one port.

The page may talk to nothing but this server: the viewer's own usage statistics, fonts and update
checks stay unsent.
"""

import contextlib
import os
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlencode

from services.logger.export.errors import ExportError

HOST = "127.0.0.1"
RECORDING = "/recording.rrd"
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:"
"""Content-Security-Policy: nothing from and to elsewhere."""
_PAGES = {
    "/": "text/html",
    "/re_viewer.js": "text/javascript",
    "/re_viewer_bg.wasm": "application/wasm",
    "/favicon.ico": "image/x-icon",
}
_START_PATIENCE = 60.0
"""For the viewer's own server [s]."""

Pages = Mapping[str, tuple[str, bytes]]
"""Content type and content by path."""


class WebView:
    """The server; :meth:`serve` blocks until interrupted."""

    def __init__(self, recording: Path, pages: Pages, port: int = 0) -> None:
        """Bind to ``port`` of the loopback interface; 0: any free one.

        Raises:
            ExportError: the port is taken.
        """
        try:
            self._server = ThreadingHTTPServer((HOST, port), partial(_Handler, recording, pages))
        except OSError as error:
            raise ExportError(
                f"cannot serve on {HOST}:{port}: {error.strerror}; give another --port, or none"
            ) from error

    @property
    def url(self) -> str:
        """What to open in a browser."""
        base = f"http://{HOST}:{self._server.server_port}"
        query = urlencode({"url": base + RECORDING, "hide_welcome_screen": "1"})
        return f"{base}/?{query}"

    def serve(self) -> None:
        """Answer requests until :meth:`close` or an interrupt."""
        with self._server:
            self._server.serve_forever()

    def close(self) -> None:
        """End :meth:`serve` from another thread."""
        self._server.shutdown()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def __init__(self, recording: Path, pages: Pages, *arguments: object) -> None:
        self._recording = recording
        self._pages = pages
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path == RECORDING:
            self._answer("application/octet-stream", self._recording.read_bytes())
        elif path in self._pages:
            self._answer(*self._pages[path])
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def log_message(self, *_: object) -> None:
        """Requests are nothing to tell a person about."""

    def _answer(self, kind: str, content: bytes) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("Cache-Control", "no-cache")
        self.end_headers()
        self.wfile.write(content)


def viewer_pages(command: Sequence[str], environment: Mapping[str, str]) -> Pages:
    """The web viewer's files, asked of ``command`` (the ``rerun`` program).

    Raises:
        ExportError: it does not serve them.
    """
    port = _free_port()
    # Given a recording's address it serves the pages alone; the address is never opened.
    serve = ["--serve-web", "--bind", HOST, "--port", "auto", "--web-viewer-port", str(port)]
    child = subprocess.Popen(
        [*command, f"http://{HOST}:{port}{RECORDING}", *serve],
        env=dict(environment),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return {
            path: (kind, _fetch(f"http://{HOST}:{port}{path}", child))
            for path, kind in _PAGES.items()
        }
    finally:
        # The command is a script around the program: both have to end.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGTERM)
        child.wait()


def _fetch(url: str, server: "subprocess.Popen[bytes]") -> bytes:
    deadline = time.monotonic() + _START_PATIENCE
    while True:
        try:
            with urllib.request.urlopen(url) as answer:
                return bytes(answer.read())
        except (urllib.error.URLError, ConnectionError) as error:
            if server.poll() is not None or time.monotonic() > deadline:
                raise ExportError(
                    f"Rerun's web viewer does not serve {url}: {error}; try `rerun --version`"
                ) from error
        time.sleep(0.1)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
