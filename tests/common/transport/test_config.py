"""Where a service listens and whom it connects to, from defaults, file, environment, arguments."""

import itertools
from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigError
from common.ports import PORT_OFFSETS
from common.topics import ALL_TOPICS, HEALTH, PLANT_STATE
from common.transport.config import BusConfig, bus_config, read_config_file, split_list
from common.transport.keys import key_of, subscription_of, topic_of


def test_every_service_listens_on_its_port_and_every_pair_is_connected_once() -> None:
    config = BusConfig(base_port=20_000)
    owners = {}
    for name, offset in PORT_OFFSETS.items():
        (endpoint,) = config.listen_endpoints(name)
        assert endpoint == f"tcp/127.0.0.1:{20_000 + offset}"
        owners[endpoint] = name
    pairs = [
        frozenset((name, owners[endpoint]))
        for name in PORT_OFFSETS
        for endpoint in config.connect_endpoints(name)
    ]
    assert sorted(map(sorted, pairs)) == sorted(
        sorted(pair) for pair in itertools.combinations(PORT_OFFSETS, 2)
    )


def test_a_service_outside_the_table_listens_anywhere_and_connects_to_all() -> None:
    config = BusConfig()
    assert config.listen_endpoints("probe") == ["tcp/127.0.0.1:0"]
    table = [f"tcp/127.0.0.1:{config.base_port + offset}" for offset in PORT_OFFSETS.values()]
    # The router too: who comes in there is not in the table.
    assert config.connect_endpoints("probe") == [*table, f"tcp/127.0.0.1:{config.base_port - 1}"]


def test_a_client_listens_nowhere() -> None:
    config = BusConfig(mode="client", connect=("tcp/router:7447",))
    assert config.listen_endpoints("wbc") == []
    assert config.connect_endpoints("wbc") == ["tcp/router:7447"]
    assert BusConfig(mode="client").connect_endpoints("wbc") == ["tcp/127.0.0.1:7447"]


def test_zenoh_settings_keep_publishers_from_waiting() -> None:
    config = BusConfig(lease_ms=1200, queue_size=8, drop_wait_us=400).zenoh_config("sim")
    assert config["scouting"]["multicast"]["enabled"] is False
    assert config["scouting"]["gossip"]["enabled"] is True
    assert config["connect"]["exit_on_failure"] is False
    tx = config["transport"]["link"]["tx"]
    assert tx["lease"] == 1200
    assert tx["queue"]["size"]["real_time"] == 8
    drop = tx["queue"]["congestion_control"]["drop"]
    assert drop == {"wait_before_drop": 400, "max_wait_before_drop_fragments": 3000}
    assert config["transport"]["shared_memory"]["enabled"] is False


def test_overlay_adds_and_replaces_without_forgetting_the_rest() -> None:
    overlay: dict[str, Any] = {
        "transport": {"link": {"tls": {"enable_mtls": True}, "tx": {"lease": 999}}},
        "access_control": {"enabled": True},
    }
    config = BusConfig(zenoh=overlay).zenoh_config("sim")
    link = config["transport"]["link"]
    assert link["tls"] == {"enable_mtls": True}
    assert link["tx"]["lease"] == 999
    assert "queue" in link["tx"]
    assert config["access_control"] == {"enabled": True}


def test_arguments_win_over_environment_over_file() -> None:
    table = {"robot": "file", "base_port": 2000, "mode": "client", "lease_ms": 700}
    environment = {
        "TRILL_ROBOT": "environment",
        "TRILL_BASE_PORT": "3000",
        "TRILL_CONNECT": "tcp/a:1, tcp/b:2",
        "TRILL_LISTEN": "",
    }
    config = bus_config(table, {"robot": "argument", "base_port": None}, environment)
    assert config.robot == "argument"
    assert config.base_port == 3000
    assert config.connect == ("tcp/a:1", "tcp/b:2")
    assert config.listen is None
    assert (config.mode, config.lease_ms) == ("client", 700)


@pytest.mark.parametrize(
    "table",
    [
        {"robot": "two words"},
        {"robot": "a/b"},
        {"robot": "*"},
        {"mode": "boss"},
        {"base_port": 80},
        {"lease": 3},
    ],
)
def test_wrong_values_are_refused(table: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(table))):
        bus_config(table, {}, {})


def test_config_file(tmp_path: Path) -> None:
    path = tmp_path / "stack.toml"
    path.write_text('[bus]\nrobot = "r2"\n[links]\n"plant/state" = "5ms"\n')
    assert read_config_file(path) == {"bus": {"robot": "r2"}, "links": {"plant/state": "5ms"}}
    path.write_text("robot = ")
    with pytest.raises(ConfigError, match=r"stack\.toml"):
        read_config_file(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_config_file(tmp_path / "missing.toml")


def test_only_known_tables_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "stack.toml"
    path.write_text("[wcb]\nrate = 200\n")
    with pytest.raises(ConfigError, match=r"stack\.toml: no table \[wcb\]; .*runtime.*sim.*wbc"):
        read_config_file(path)
    assert read_config_file(path, also=["wcb"]) == {"wcb": {"rate": 200}}


def test_wrong_values_are_told_in_a_line_each() -> None:
    with pytest.raises(ConfigError) as caught:
        bus_config({"base_port": 3, "zenoh": [], "speed": 1}, {}, {})
    assert str(caught.value).splitlines() == [
        "the bus configuration is wrong: base_port: Input should be greater than or equal to 1024 "
        "(got 3)",
        "zenoh: Input should be a valid dictionary (got [])",
        "speed: no such key",
    ]


def test_lists_are_split_at_commas() -> None:
    assert split_list(" a, b,,c ") == ("a", "b", "c")
    assert split_list("") == ()


def test_keys_and_topics_belong_together() -> None:
    assert key_of("r2", PLANT_STATE, "sim") == "r2/plant/state"
    assert key_of("r2", HEALTH, "sim") == "r2/health/sim"
    assert subscription_of("r2", HEALTH) == "r2/health/*"
    for topic in ALL_TOPICS:
        assert topic_of("r2", key_of("r2", topic, "sim")) is topic


@pytest.mark.parametrize(
    "key", ["r1/plant/state", "r2/plant", "r2/health", "r2/health/a/b", "r2/plant/state/sim", "x"]
)
def test_foreign_keys_have_no_topic(key: str) -> None:
    assert topic_of("r2", key) is None
