"""Reserve a block of ports for one system, so that several run side by side on a machine."""

import contextlib
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


@contextlib.contextmanager
def reserve_base_port(host: str = "127.0.0.1", wanted: int | None = None) -> Iterator[int]:
    """Yield a base port whose whole block is free on ``host``: ``wanted``, or the first one.

    The block stays marked inside the context.

    Raises:
        DeployError: a port of ``wanted`` is in use, or no block is free.
    """
    offsets = (ROUTER_OFFSET, *PORT_OFFSETS.values())
    candidates = (
        [DEFAULT_BASE_PORT + STRIDE * block for block in range(BLOCKS)]
        if wanted is None
        else [wanted]
    )
    for base in candidates:
        mark = _bound(host, base + _MARK, shared=False)
        if mark is None:
            continue
        with mark:
            if all(_free(host, base + offset) for offset in offsets):
                yield base
                return
    if wanted is None:
        raise DeployError(
            f"no {STRIDE} free ports in a row on {host} from {candidates[0] + _FIRST} to "
            f"{candidates[-1] + _MARK}; stop a running system or pass --base-port"
        )
    raise DeployError(
        f"ports {wanted + _FIRST} to {wanted + _MARK} on {host} are not all free; leave "
        "out --base-port to have free ones chosen, or stop the program that uses them"
    )


def _bound(host: str, port: int, *, shared: bool) -> socket.socket | None:
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if shared:  # like the services: a port whose last connection is still closing counts as free
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, port))
    except OSError:
        sock.close()
        return None
    return sock


def _free(host: str, port: int) -> bool:
    sock = _bound(host, port, shared=True)
    if sock is None:
        return False
    sock.close()
    return True
