"""Serves a recording with Rerun's web viewer on this machine only, from one port.

Rerun's own server (``rr.serve_web_viewer``) is not used: it listens on all interfaces, and its page
loads fonts from elsewhere and sends usage statistics, which cannot be switched off. Here the page
is served under a Content-Security-Policy that lets it communicate with this server only.
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
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlencode

from services.logger.errors import ExportError

HOST = "127.0.0.1"
RECORDING = "recording.rrd"
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:"
"""Content-Security-Policy: nothing from and to elsewhere."""
PAGES = ("index.html", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""Files of the web viewer."""
_START_TIMEOUT = 60.0
"""Time that Rerun's own server has for starting [s]."""


def web_server(directory: Path, port: int = 0) -> ThreadingHTTPServer:
    """Return an HTTP server of ``directory``, bound to the loopback interface but not yet running.

    The directory holds the web viewer's :data:`PAGES` and the :data:`RECORDING`; port 0 takes any
    free one.

    Raises:
        ExportError: the port is taken.
    """
    try:
        return ThreadingHTTPServer((HOST, port), partial(_Handler, directory=str(directory)))
    except OSError as error:
        raise ExportError(
            f"cannot serve on {HOST}:{port}: {error.strerror}; give another --port, or none"
        ) from error


def address_of(server: ThreadingHTTPServer) -> str:
    """Return the address to open in a browser."""
    base = f"http://{HOST}:{server.server_port}"
    return f"{base}/?{urlencode({'url': f'{base}/{RECORDING}', 'hide_welcome_screen': '1'})}"


class _Handler(SimpleHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def end_headers(self) -> None:
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("Cache-Control", "no-cache")
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Print nothing for a request."""


def fetch_viewer(directory: Path, command: Sequence[str], environment: Mapping[str, str]) -> None:
    """Copy the web viewer's files to ``directory`` from inside the ``rerun`` program.

    ``command`` and ``environment`` run that program.

    Raises:
        ExportError: it does not serve them.
    """
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        base = f"http://{HOST}:{probe.getsockname()[1]}"
    # Given a recording's address it serves the pages alone; the address is never opened.
    serve = ["--serve-web", "--bind", HOST, "--port", "auto", "--web-viewer-port"]
    child = subprocess.Popen(
        [*command, f"{base}/{RECORDING}", *serve, base.rpartition(":")[2]],
        env=dict(environment),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        for name in PAGES:
            page = name.removeprefix("index.html")
            (directory / name).write_bytes(_fetch(f"{base}/{page}", child))
    finally:
        # The command is a script around the program: both have to end.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGTERM)
        child.wait()


def _fetch(url: str, server: "subprocess.Popen[bytes]") -> bytes:
    deadline = time.monotonic() + _START_TIMEOUT
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
