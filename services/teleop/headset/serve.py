"""Serve the page of the operator in a browser or a headset, and print the link to it."""

import io
import sys

import segno

from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.credentials import Credentials, prepare
from services.teleop.headset.hub import Hub
from services.teleop.headset.server import WebServer
from services.teleop.headset.service import HeadsetOperator


def serve(config: HeadsetConfig, *, new_token: bool = False) -> HeadsetOperator:
    """Start the web server, print the link, and return the operator that ends the server.

    Raises:
        TeleopError: the page cannot be served.
    """
    credentials, hub = prepare(config, new_token=new_token), Hub()
    server = WebServer(config, credentials, hub)
    server.start()
    print(invitation(credentials, server.port), flush=True)
    return HeadsetOperator(config, hub, server.close)


def link(credentials: Credentials, port: int) -> str:
    """Return the link to the page.

    The token stands behind the ``#``, so that browsers keep it out of requests and their logs.
    """
    scheme = "http" if credentials.context is None else "https"
    name = credentials.names[0]
    host = f"[{name}]" if ":" in name else name
    return f"{scheme}://{host}:{port}/#{credentials.token}"


def invitation(credentials: Credentials, port: int) -> str:
    """Return what a person needs to open the page, as text."""
    url = link(credentials, port)
    lines = [f"open {url}"]
    if credentials.context is None:
        lines += [
            "in a browser of this machine. A headset on a USB cable can open the same link after",
            f"adb reverse tcp:{port} tcp:{port}; with --lan it needs no cable.",
        ]
    else:
        lines += [
            "in a browser or a headset of your network. It warns once that it does not know the",
            "certificate, which was made here; its SHA-256 fingerprint is",
            credentials.fingerprint,
        ]
    if sys.stdout.isatty():
        lines.append(_qr_code(url))
    return "\n".join(lines)


def _qr_code(text: str) -> str:
    code = io.StringIO()
    segno.make(text, error="l").terminal(code, compact=True, border=2)
    return code.getvalue().rstrip("\n")
