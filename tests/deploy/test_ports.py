"""Two systems on one machine get different ports."""

import socket

import pytest

from common.ports import ROUTER_OFFSET
from deploy.errors import DeployError
from deploy.ports import STRIDE, reserve_base_port
from tests.common.transport.support import free_base_port


def test_two_reservations_differ_by_whole_blocks() -> None:
    with reserve_base_port() as first, reserve_base_port() as second:
        assert first != second
        assert (second - first) % STRIDE == 0


def test_a_block_with_one_port_in_use_is_passed_over() -> None:
    with reserve_base_port() as free:
        pass
    with socket.create_server(("127.0.0.1", free + 3)), reserve_base_port() as other:
        assert other != free


def test_the_routers_port_belongs_to_the_block() -> None:
    with reserve_base_port() as free:
        pass
    taken = socket.create_server(("127.0.0.1", free + ROUTER_OFFSET))
    with taken, reserve_base_port() as other:
        assert other != free


def test_neighbouring_blocks_do_not_overlap() -> None:
    base = free_base_port(2 * STRIDE) + 1
    with reserve_base_port(wanted=base), reserve_base_port(wanted=base + STRIDE) as second:
        assert second == base + STRIDE


def test_a_wanted_block_that_is_taken_is_refused() -> None:
    with (
        reserve_base_port() as taken,
        pytest.raises(DeployError, match="not all free"),
        reserve_base_port(wanted=taken),
    ):
        pass
