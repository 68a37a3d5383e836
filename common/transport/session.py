"""Open the Zenoh session."""

import json
import secrets
import time
from collections.abc import Callable
from typing import Any

import zenoh

from common.errors import TrillError
from common.transport.config import BusConfig


class BusError(TrillError):
    """The bus cannot be reached or set up."""


def open_session(
    config: BusConfig, service: str, stopping: Callable[[], bool] = lambda: False
) -> "zenoh.Session":
    """Open a session for ``service``; peers that are not up yet are found later.

    A client cannot open without its router, so it retries for ``config.patience_s`` or until
    ``stopping`` returns True.

    Raises:
        BusError: Zenoh refuses the configuration, an endpoint cannot be listened on, or a client
            finds no router.
    """
    zenoh.init_log_from_env_or("error")
    text = json.dumps(config.zenoh_config(service))
    give_up = time.monotonic() + (config.patience_s if config.mode == "client" else 0.0)
    while True:
        try:
            return zenoh.open(zenoh.Config.from_json5(text))
        except zenoh.ZError as error:
            hopeless = _is_malformed(str(error))
            if hopeless or time.monotonic() >= give_up or stopping():
                raise BusError(_open_error(config, service, str(error))) from error
        time.sleep(1e-3 * config.retry_max_ms)


def _open_error(config: BusConfig, service: str, text: str) -> str:
    """Return an error text with the endpoints that were tried and how to mend it."""
    # After it come places in the transport's sources, one per layer.
    reason = text.partition(" at /")[0].strip()
    if _is_malformed(reason):
        return f"{service} cannot open the bus: {reason}; {_ENDPOINT_HELP}"
    if config.mode == "client":
        return (
            f"{service} cannot reach the bus as a client of "
            f"{', '.join(config.connect_endpoints(service))}: {reason}; expected a router there, "
            "with the same protocol and credentials"
        )
    text = (
        f"{service} cannot open the bus as {config.mode} listening on "
        f"{', '.join(config.listen_endpoints(service)) or 'nothing'}: {reason}"
    )
    if "address already in use" in reason.lower():
        return f"{text}; expected free ports (is another stack running? choose another base port)"
    if "failed to lookup address" in reason:
        return f"{text}; the host's name cannot be resolved: mend it or give the address"
    return text


_ENDPOINT_HELP = "expected an endpoint such as tcp/127.0.0.1:7448 (protocol/host:port)"


def _is_malformed(reason: str) -> bool:
    """Whether the transport could not parse an endpoint."""
    return any(
        sign in reason
        for sign in ("Endpoints must be of the form", "invalid port value", "not supported for")
    )


def new_boot_id() -> int:
    """Return a random id for this process."""
    return secrets.randbits(63)


def wire_encoding(tag: str) -> "zenoh.Encoding":
    """Return the Zenoh encoding that names a schema."""
    return zenoh.Encoding("application/msgpack").with_schema(tag)


def tag_of(encoding: Any) -> str:
    """Return the schema tag in a Zenoh encoding; empty if it has none."""
    return str(encoding).partition(";")[2]
