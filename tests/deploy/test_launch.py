"""A system that is started here is a bus of its own, whatever the shell and the file say."""

from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigError
from common.runtime.live.main import argument_parser, load_settings
from common.topics import HEALTH, PLANT_STATE
from common.transport.config import BusConfig
from common.transport.schema_query import SchemaServer
from common.transport.session import open_session
from deploy import launch
from deploy.errors import DeployError
from deploy.launch import RunningSystem, running_system
from deploy.ports import STRIDE, reserve_base_port
from deploy.system import SystemOptions, environment
from tests.common.transport.support import free_base_port

OTHERS = {
    "TRILL_MODE": "client",
    "TRILL_CONNECT": "tcp/127.0.0.1:7447",
    "TRILL_LISTEN": "tcp/127.0.0.1:9000",
}


@pytest.fixture(autouse=True)
def _no_processes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(launch, "robot_processes", lambda _options, _run_dir: [])
    monkeypatch.chdir(tmp_path)
    for name in ("TRILL_ROBOT", "TRILL_HOST", "TRILL_BASE_PORT", "TRILL_CONFIG", *OTHERS):
        monkeypatch.delenv(name, raising=False)


def config_file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "system.toml"
    path.write_text(text)
    return path


def bus_of_service(name: str, system: RunningSystem, config: Path | None = None) -> BusConfig:
    """What a service of the system makes of its environment, which holds the shell's too."""
    variables = {**OTHERS, "TRILL_ROBOT": "another", **environment(system.bus, config)}
    return load_settings(argument_parser(name).parse_args([]), name, variables)[0]


@pytest.mark.parametrize("by_file", [False, True])
def test_nothing_inherited_makes_it_join_another_system(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    by_file: bool,
) -> None:
    config = None
    if by_file:
        config = config_file(
            tmp_path,
            '[bus]\nmode = "client"\nconnect = ["tcp/127.0.0.1:7447"]\nlisten = ["tcp/[::]:9"]\n',
        )
    else:
        for name, value in OTHERS.items():
            monkeypatch.setenv(name, value)
    with running_system(SystemOptions(config=config), None) as system:
        port = system.bus.base_port
        # The live table of `trill demo` reads this bus.
        assert (system.bus.mode, system.bus.connect, system.bus.listen) == ("peer", None, None)
        bus = bus_of_service("wbc", system, config)
    assert bus.robot == "draco3"
    assert bus.mode == "peer"
    assert bus.listen_endpoints("wbc") == [f"tcp/127.0.0.1:{port + 1}"]
    assert bus.connect_endpoints("wbc") == [f"tcp/127.0.0.1:{port}"]
    said = capsys.readouterr().err
    assert "not used" in said
    assert all(name in said for name in OTHERS)


def test_raw_settings_that_would_join_another_bus_are_refused(tmp_path: Path) -> None:
    text = '[bus.zenoh.connect]\nendpoints = ["tcp/127.0.0.1:7447"]\n'
    options = SystemOptions(config=config_file(tmp_path, text))
    with pytest.raises(ConfigError, match="connect"), running_system(options, None):
        pass
    text = '[bus.zenoh.transport.link.tls]\nroot_ca_certificate = "ca.pem"\n'
    with running_system(SystemOptions(config=config_file(tmp_path, text)), None) as system:
        assert system.bus.zenoh["transport"]


@pytest.mark.parametrize("by_file", [False, True])
def test_a_configured_base_port_is_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, by_file: bool
) -> None:
    wanted = free_base_port(2 * STRIDE) + 1
    config = None
    if by_file:
        config = config_file(tmp_path, f"[bus]\nbase_port = {wanted}\n")
    else:
        monkeypatch.setenv("TRILL_BASE_PORT", str(wanted))
    with running_system(SystemOptions(config=config), None) as system:
        assert system.bus.base_port == wanted
        assert bus_of_service("sim", system, config).base_port == wanted


def test_a_system_that_runs_at_the_wanted_ports_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "_LOOK_S", 2.0)
    with reserve_base_port() as port:
        session: Any = open_session(BusConfig(base_port=port), "sim")
        server = SchemaServer(session, "draco3", "sim", (PLANT_STATE, HEALTH))
        with (
            pytest.raises(DeployError, match=r"draco3 is running there: sim$"),
            running_system(SystemOptions(), port),
        ):
            pass
        server.close()
        session.close()


def test_an_ipv6_host_is_used_like_any_other() -> None:
    with reserve_base_port("::1") as port:
        pass
    bus = BusConfig(host="::1", base_port=port)
    assert bus.listen_endpoints("wbc") == [f"tcp/[::1]:{port + 1}"]
    assert bus.connect_endpoints("wbc") == [f"tcp/[::1]:{port}"]
    session: Any = open_session(bus, "wbc")
    session.close()


@pytest.mark.parametrize(
    ("host", "token"),
    [("192.0.2.7", "no address of this machine"), ("no.such.host.invalid", "resolved")],
)
def test_a_host_that_is_not_this_machine_is_explained(
    monkeypatch: pytest.MonkeyPatch, host: str, token: str
) -> None:
    monkeypatch.setenv("TRILL_HOST", host)
    with pytest.raises(DeployError, match=token), running_system(SystemOptions(), None):
        pass
    assert not Path("runs").exists()
