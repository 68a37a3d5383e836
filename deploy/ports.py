"""Reserve a block of ports for one system, so that several run side by side on a machine."""

import contextlib
import errno
import socket
from collections.abc import Iterator

from common.ports import DEFAULT_BASE_PORT, PORT_OFFSETS, ROUTER_OFFSET
from deploy.errors import DeployError

STRIDE = 16
"""Distance between the base ports of two systems."""
BLOCKS = 200
_FIRST = ROUTER_OFFSET
"""Offset of a block's lowest port; the others follow it."""
_MARK = _FIRST + STRIDE - 1
"""Offset of the block's highest port, which the owner keeps open to mark the block as taken."""


class PortsTakenError(DeployError):
    """A port of the wanted block is in use."""


@contextlib.contextmanager
def reserve_base_port(host: str = "127.0.0.1", wanted: int | None = None) -> Iterator[int]:
    """Yield a base port whose whole block is free on ``host``: ``wanted``, or the first one.

    The block stays marked inside the context.

    Raises:
        DeployError: ``host`` is no address of this machine, or no block is free.
        PortsTakenError: a port of ``wanted`` is in use.
    """
    family, address = _own_address(host)
    offsets = (ROUTER_OFFSET, *PORT_OFFSETS.values())
    candidates = (
        [DEFAULT_BASE_PORT + STRIDE * block for block in range(BLOCKS)]
        if wanted is None
        else [wanted]
    )
    for base in candidates:
        mark = _bound(family, address, base + _MARK, shared=False)
        if mark is None:
            continue
        with mark:
            if all(_free(family, address, base + offset) for offset in offsets):
                yield base
                return
    if wanted is None:
        raise DeployError(
            f"no {STRIDE} free ports in a row on {host} from {candidates[0] + _FIRST} to "
            f"{candidates[-1] + _MARK}; stop a running system or pass --base-port"
        )
    raise PortsTakenError(
        f"ports {wanted + _FIRST} to {wanted + _MARK} on {host} are not all free; leave the base "
        "port out (--base-port, TRILL_BASE_PORT, [bus] base_port) to have free ones chosen, or "
        "stop the program that uses them"
    )


def _own_address(host: str) -> tuple[int, str]:
    """Return family and numeric form of an address of this machine.

    Raises:
        DeployError: it is none.
    """
    try:
        family, _, _, _, resolved = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise DeployError(
            f"the host {host!r} cannot be resolved: {error.strerror}; expected an address of this "
            "machine in TRILL_HOST, [bus] host or --host"
        ) from error
    address = str(resolved[0])
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind((address, 0))
    except OSError as error:
        raise DeployError(
            f"{host} is no address of this machine that a service can listen on: {error.strerror}; "
            "leave TRILL_HOST and [bus] host out for loopback, or give one of this machine's own"
        ) from error
    return family, address


def _bound(family: int, address: str, port: int, *, shared: bool) -> socket.socket | None:
    """Return a socket bound to a port; None if the port is in use.

    Raises:
        DeployError: it cannot be bound for any other reason.
    """
    sock = socket.socket(family, socket.SOCK_STREAM)
    if shared:  # like the services: a port whose last connection is still closing counts as free
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((address, port))
    except OSError as error:
        sock.close()
        if error.errno != errno.EADDRINUSE:
            raise DeployError(
                f"cannot listen on port {port} of {address}: {error.strerror}"
            ) from error
        return None
    return sock


def _free(family: int, address: str, port: int) -> bool:
    sock = _bound(family, address, port, shared=True)
    if sock is None:
        return False
    sock.close()
    return True
