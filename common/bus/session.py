"""Opening the Zenoh session."""

import json
import secrets
from typing import Any

import zenoh

from common.bus.config import BusConfig
from common.errors import TrillError


class BusError(TrillError):
    """The bus cannot be reached or set up."""


def open_session(config: BusConfig, service: str) -> "zenoh.Session":
    """Open a session for ``service``; peers that are not there yet are found later.

    Args:
        config: how to reach the bus.
        service: chooses the listening port of the table.

    Raises:
        BusError: the configuration is not one Zenoh takes, or an endpoint cannot be listened on.
    """
    zenoh.init_log_from_env_or("error")
    text = json.dumps(config.zenoh_config(service))
    try:
        return zenoh.open(zenoh.Config.from_json5(text))
    except zenoh.ZError as error:
        # What follows are places in the transport's sources, one per layer.
        reason = str(error).partition(" at /")[0]
        raise BusError(
            f"{service} cannot open the bus as {config.mode} listening on "
            f"{config.listen_endpoints(service) or 'nothing'}: {reason}; expected free ports (is "
            "another stack running? choose another base port) and reachable endpoints"
        ) from error


def new_boot_id() -> int:
    """Return a random id for this process's life."""
    return secrets.randbits(63)


def wire_encoding(tag: str) -> "zenoh.Encoding":
    """Return the Zenoh encoding that names a schema."""
    return zenoh.Encoding("application/msgpack").with_schema(tag)


def tag_of(encoding: Any) -> str:
    """Return the schema tag in a Zenoh encoding; empty if it has none."""
    return str(encoding).partition(";")[2]
