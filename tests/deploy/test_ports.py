"""Two systems on one machine get different ports."""

import socket

import pytest

from deploy.errors import DeployError
from deploy.ports import STRIDE, reserve_base_port


def test_two_reservations_differ_by_whole_blocks() -> None:
    with reserve_base_port() as first, reserve_base_port() as second:
        assert first != second
        assert (second - first) % STRIDE == 0


def test_a_block_with_one_port_in_use_is_passed_over() -> None:
    with reserve_base_port() as free:
        pass
    with socket.create_server(("127.0.0.1", free + 3)), reserve_base_port() as other:
        assert other != free


def test_a_wanted_block_that_is_taken_is_refused() -> None:
    with (
        reserve_base_port() as taken,
        pytest.raises(DeployError, match="not all free"),
        reserve_base_port(wanted=taken),
    ):
        pass
