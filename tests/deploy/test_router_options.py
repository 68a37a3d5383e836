"""The router's options, and what it says of mistakes."""

import socket
import subprocess
import sys

import pytest

from common.ports import ROUTER_OFFSET
from common.transport.config import BusConfig, bus_of
from deploy.router import describe, parser, router_config
from tests.common.transport.support import free_base_port


def run(*options: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "deploy.router", *options],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_a_taken_port_is_named_with_a_way_out() -> None:
    base_port = free_base_port()
    with socket.create_server(("127.0.0.1", base_port + ROUTER_OFFSET)):
        ended = run("--base-port", str(base_port))
    assert ended.returncode == 1
    assert f"tcp/127.0.0.1:{base_port + ROUTER_OFFSET}" in ended.stderr
    assert "choose another base port" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("options", "code", "complaint"),
    [
        (("--listen", "7447"), 1, "expected an endpoint such as tcp/"),
        (("--base-port", "12"), 2, "base_port"),
        (("--config", "missing.toml"), 2, "cannot read the configuration missing.toml"),
        (("--speed", "9"), 2, "unrecognized arguments"),
    ],
)
def test_wrong_options_are_explained(options: tuple[str, ...], code: int, complaint: str) -> None:
    ended = run(*options)
    assert ended.returncode == code
    assert complaint in ended.stderr
    assert "Traceback" not in ended.stderr


def test_it_needs_only_the_base_package() -> None:
    """Extras bring these; a router's image has none of them."""
    program = (
        "import sys\n"
        "extras = ('rich', 'mcap', 'mujoco', 'pinocchio', 'cv2', 'scipy', 'osqp', 'zstandard')\n"
        "sys.modules |= dict.fromkeys(extras)\n"
        "sys.argv[1:] = ['--help']\n"
        "import runpy; runpy.run_module('deploy.router', run_name='__main__')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert "examples:" in ended.stdout


def test_where_it_listens_and_whom_it_connects_to() -> None:
    standard = router_config(BusConfig())
    assert standard.mode == "router"
    assert standard.listen_endpoints("router") == ["tcp/127.0.0.1:7447"]
    # Whoever is in no table dials the whole table and the router itself.
    assert BusConfig().connect_endpoints("probe") == [
        *standard.connect_endpoints("router"),
        "tcp/127.0.0.1:7447",
    ]
    given = parser().parse_args(["--listen", "tcp/0.0.0.0:1", "--connect", "tcp/a:2,tcp/b:3"])
    config = router_config(bus_of(**vars(given)))
    assert (config.mode, config.listen) == ("router", ("tcp/0.0.0.0:1",))
    assert config.connect == ("tcp/a:2", "tcp/b:3")
    bus = BusConfig(mode="client", listen=("tcp/e:4",), connect=("tcp/f:5",))
    assert router_config(bus).listen_endpoints("router") == ["tcp/e:4"]
    assert router_config(bus).connect_endpoints("router") == ["tcp/f:5"]


def test_who_is_connected_in_words() -> None:
    assert describe([]) == "nobody"
    assert describe(["client"]) == "1 client"
    assert describe(["client", "peer", "router", "peer"]) == "2 peers, 1 client, 1 router"
