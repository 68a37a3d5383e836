"""The containers' declarations, without a container engine."""

import argparse
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml

from common.links.config import Links, parse_link_options
from common.links.spec import LinkSpec
from common.ports import DEFAULT_BASE_PORT, PORT_OFFSETS, ROUTER_OFFSET
from common.transport.config import bus_config
from services.sim.__main__ import _add_arguments

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
SERVICES = ("router", "logger", "wbc", "sim", "cameras", "policy", "player", "teleop")
CLIENTS = ("logger", "cameras", "policy", "player")
"""Those that reach the others through the router."""
CONTROL = ("sim", "wbc", "teleop")
EXTRAS = {
    "router": "",
    "logger": "logger",
    "wbc": "wbc",
    "sim": "sim",
    "cameras": "sim",
    "policy": "policy",
    "player": "player",
    "teleop": "teleop",
}
"""The one extra each image may install."""
LATENCIES = {"latency-250": 0.25, "latency-500": 0.5}

Table = dict[str, Any]


def load(name: str) -> Table:
    table: Table = yaml.safe_load((DEPLOY / name).read_text())
    return table


@cache
def services() -> dict[str, Table]:
    table: dict[str, Table] = load("compose.yaml")["services"]
    return table


def filled(value: str, **variables: str) -> str:
    """``value`` with ``${NAME:-default}`` replaced as compose does."""
    return re.sub(r"\$\{(\w+):-([^}]*)\}", lambda found: variables.get(found[1]) or found[2], value)


def environment(service: Table) -> dict[str, str]:
    return {name: filled(str(text)) for name, text in service["environment"].items()}


def command(service: Table, **variables: str) -> list[str]:
    return [filled(word, **variables) for word in service.get("command", [])]


def merged(base: Table, override: Table) -> Table:
    """As compose merges files: tables by key, anything else replaced."""
    result = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


class Image:
    """One stage of the Containerfile with everything it is made from."""

    def __init__(self, stages: dict[str, list[str]], target: str) -> None:
        self.lines: list[str] = []
        self._gather(stages, target)

    def _gather(self, stages: dict[str, list[str]], name: str) -> None:
        for line in stages.get(name, []):
            self.lines.append(line)
            for source in re.findall(r"^FROM (\S+)|--from=(\w[\w-]*)", line):
                self._gather(stages, source[0] or source[1])

    @property
    def extras(self) -> set[str]:
        return {
            name
            for line in self.lines
            for group in re.findall(r"install '?\.\[([^\]]*)\]", line)
            for name in group.split(",")
        }

    @property
    def module(self) -> str:
        (entry,) = (line for line in self.lines if line.startswith("ENTRYPOINT"))
        words: list[str] = yaml.safe_load(entry.removeprefix("ENTRYPOINT "))
        assert words[:2] == ["python3", "-m"]
        return words[2]

    @property
    def user(self) -> str:
        users = [line.split()[1] for line in self.lines if line.startswith("USER ")]
        return users[-1] if users else "root"


def stages_of(text: str) -> dict[str, list[str]]:
    """Instructions of each named stage, continuation lines joined, comments left out."""
    joined = re.sub(r"\\\n\s*", "", re.sub(r"(?m)^\s*#.*\n", "", text))
    stages: dict[str, list[str]] = {}
    name = ""
    for line in joined.splitlines():
        if found := re.match(r"FROM \S+ AS (\S+)", line):
            name = found[1]
        if name and line.strip():
            stages.setdefault(name, []).append(line)
    return stages


def image(target: str) -> Image:
    stages = stages_of((DEPLOY / "Containerfile").read_text())
    assert target in stages, f"no stage {target!r} in the Containerfile"
    return Image(stages, target)


def test_the_services_that_exist_are_there() -> None:
    assert set(services()) == set(SERVICES)
    assert all(importlib.util.find_spec(image(name).module) for name in SERVICES)


@pytest.mark.parametrize("name", SERVICES)
def test_each_image_is_its_own_target_with_only_its_own_extra(name: str) -> None:
    assert services()[name]["build"]["target"] == name
    found = image(name)
    assert found.extras == ({EXTRAS[name]} if EXTRAS[name] else set())
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = " ".join(
        [*packages["dependencies"], *packages["optional-dependencies"].get(EXTRAS[name], [])]
    )
    assert ("torch" in asked + " ".join(found.lines)) == (name == "policy")
    assert ("mujoco" in asked) == (name in {"sim", "cameras"})


def test_an_extra_in_any_stage_an_image_is_made_from_is_found() -> None:
    text = """
ARG BASE=x
FROM ${BASE} AS one
RUN python3 -m pip install '.[sim,wbc]'
FROM one AS two
FROM ${BASE} AS three
COPY --from=two /opt /opt
USER 7
ENTRYPOINT ["python3", "-m", "services.sim"]
"""
    found = Image(stages_of(text), "three")
    assert found.extras == {"sim", "wbc"}
    assert (found.module, found.user) == ("services.sim", "7")


@pytest.mark.parametrize("name", SERVICES)
def test_it_is_confined(name: str) -> None:
    service = services()[name]
    assert service["init"] is True
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert "cap_add" not in service
    assert "privileged" not in service
    assert float(service["stop_grace_period"].removesuffix("s")) >= 10
    assert re.match(r"[1-9]\d*:", image(name).user), "runs as root"


@pytest.mark.parametrize("name", SERVICES)
def test_its_command_is_one_its_service_takes(name: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", image(name).module, *command(services()[name]), "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ended.returncode == 0, ended.stderr
    options = [word for word in command(services()[name]) if word.startswith("--")]
    assert all(option in ended.stdout for option in options)


@pytest.mark.parametrize("script", ["demo", "stand", "gaits", "random"])
def test_the_operators_script_can_be_chosen(script: str) -> None:
    words = command(services()["teleop"], TRILL_SCRIPT=script)
    assert words == ["scripted", "--script", script]


def test_the_later_of_two_control_services_connects_to_the_earlier_by_name() -> None:
    config = {name: bus_config({}, {}, environment(services()[name])) for name in CONTROL}
    for number, name in enumerate(CONTROL):
        bus = config[name]
        port = DEFAULT_BASE_PORT + PORT_OFFSETS[name]
        assert bus.mode == "peer"
        assert bus.listen_endpoints(name) == [f"tcp/0.0.0.0:{port}"]
        earlier = [
            f"tcp/{other}:{DEFAULT_BASE_PORT + PORT_OFFSETS[other]}" for other in CONTROL[:number]
        ]
        # A service that is told nothing connects to what comes before it in the port table.
        assert list(bus.connect or bus.connect_endpoints(name)) == earlier


def test_the_router_reaches_the_control_services_and_clients_reach_the_router() -> None:
    port = DEFAULT_BASE_PORT + ROUTER_OFFSET
    router = environment(services()["router"])
    assert router["TRILL_LISTEN"] == f"tcp/0.0.0.0:{port}"
    assert set(router["TRILL_CONNECT"].split(",")) == {
        f"tcp/{name}:{DEFAULT_BASE_PORT + PORT_OFFSETS[name]}" for name in CONTROL
    }
    assert [filled(text) for text in services()["router"]["ports"]] == [f"127.0.0.1:{port}:{port}"]
    for name in CLIENTS:
        bus = bus_config({}, {}, environment(services()[name]))
        assert (bus.mode, bus.listen_endpoints(name)) == ("client", [])
        assert bus.connect_endpoints(name) == [f"tcp/router:{port}"]


def test_who_names_another_shares_a_network_with_it_and_clients_share_none_with_control() -> None:
    for service in services().values():
        for endpoint in filter(None, environment(service).get("TRILL_CONNECT", "").split(",")):
            other = urlsplit(endpoint.replace("tcp/", "tcp://")).hostname or ""
            assert set(service["networks"]) & set(services()[other]["networks"])
    for client in CLIENTS:
        for name in CONTROL:
            assert not set(services()[client]["networks"]) & set(services()[name]["networks"])


def test_every_service_has_the_same_robot_and_plant_and_controller_the_same_limits() -> None:
    robots = {environment(services()[name]).get("TRILL_ROBOT") for name in SERVICES[1:]}
    assert robots == {"draco3"}
    limits = command(services()["wbc"])
    assert command(services()["sim"])[: len(limits)] == limits


def test_a_crash_is_mended_but_a_finished_script_is_over() -> None:
    assert services()["teleop"]["restart"] == "no"
    assert {services()[name]["restart"] for name in SERVICES[:-1]} == {"on-failure"}


def test_the_plant_stops_before_the_controller_and_the_logger_after_both() -> None:
    def after(name: str) -> set[str]:
        direct: list[str] = services()[name].get("depends_on", [])
        return {*direct, *(further for one in direct for further in after(one))}

    assert "wbc" in after("sim")
    assert {"sim", "wbc", "logger"} <= after("teleop")
    assert "logger" in after("wbc") & after("cameras")
    assert "router" in after("logger")


def test_a_policy_is_started_only_if_it_is_asked_for_and_cannot_write_its_checkpoint() -> None:
    for name in ("policy", "player"):
        assert services()[name]["profiles"] == [name]
        (volume,) = services()[name]["volumes"]
        folder, place, mode = filled(volume, TRILL_POLICY="best").split(":")
        assert (folder, mode) == ("best", "ro")
        assert command(services()[name])[:2] == [place, "--stay"]
        shipped = filled(volume).partition(":")[0]
        assert (DEPLOY / shipped / "config.json").is_file()
    assert all("profiles" not in services()[name] for name in set(SERVICES) - {"policy", "player"})
    assert "--remote" in command(services()["player"])


def test_the_inference_server_runs_anywhere_confined_and_as_a_client() -> None:
    service = load("compose.inference.yaml")["services"]["inference"]
    found = image(service["build"]["target"])
    assert found.module == "services.policy.server"
    assert found.extras == {"policy"}
    assert re.match(r"[1-9]\d*:", found.user)
    for key in ("init", "read_only", "cap_drop", "security_opt", "restart", "tmpfs"):
        assert service[key] == services()["cameras"][key]
    bus = bus_config({}, {}, environment(service))
    assert (bus.mode, bus.robot) == ("client", "draco3")
    assert "ports" not in service


@pytest.mark.parametrize(("task", "expected"), [("", None), ("door/unlock", "door/unlock")])
def test_the_task_can_be_chosen(task: str, expected: str | None) -> None:
    parser = argparse.ArgumentParser()
    _add_arguments(parser)
    assert parser.parse_args(command(services()["sim"], TRILL_TASK=task)).task == expected


def test_recordings_outlive_the_container() -> None:
    (volume,) = services()["logger"]["volumes"]
    name, _, place = volume.partition(":")
    assert name in load("compose.yaml")["volumes"]
    assert command(services()["logger"], TRILL_RUN="x") == ["--out", f"{place}/x"]
    assert any(f"install -d -o 10001 -g 10001 {place}" in line for line in image("logger").lines)


def test_an_emergency_stop_outlives_the_container() -> None:
    (volume,) = services()["sim"]["volumes"]
    name, _, place = volume.partition(":")
    assert name in load("compose.yaml")["volumes"]
    arguments = command(services()["sim"])
    assert arguments[arguments.index("--latch-file") + 1].startswith(f"{place}/")
    # With real-time scheduling the plant is root without the right to write anywhere.
    assert any(f"-m 1777 {place}" in line for line in image("sim").lines)


@pytest.mark.parametrize(("override", "delay"), LATENCIES.items())
def test_a_latency_file_sets_the_command_link_and_nothing_else(override: str, delay: float) -> None:
    base, table = load("compose.yaml"), load(f"compose.{override}.yaml")
    assert table.keys() == {"services"}
    assert table["services"].keys() == {"wbc"}
    assert table["services"]["wbc"].keys() == {"environment"}
    before = environment(base["services"]["wbc"])
    after = environment(merged(base, table)["services"]["wbc"])
    assert {name: after[name] for name in before} == before
    assert after.keys() - before.keys() == {"TRILL_LINKS"}
    links = Links.from_table(parse_link_options(after["TRILL_LINKS"].split(";")))
    (layer,) = links.layers
    assert {name.text for name in layer} == {"wbc:teleop/setpoint", "wbc:teleop/gait"}
    for topic in ("teleop/setpoint", "teleop/gait"):
        assert links.of("wbc", topic) == LinkSpec.model_validate(f"{1000 * delay:g}ms")
        assert links.of("logger", topic) is None


def test_the_real_time_file_grants_one_capability_and_nothing_else() -> None:
    table = load("compose.realtime.yaml")
    assert set(table) <= {"services"} | {key for key in table if key.startswith("x-")}
    assert set(table["services"]) == set(CONTROL)
    for service in table["services"].values():
        assert service == {"user": "0:0", "cap_add": ["SYS_NICE"]}


def test_the_build_context_has_what_the_package_is_made_of_and_little_else() -> None:
    lines = (ROOT / ".dockerignore").read_text().split("\n")
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = wheel["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    kept = {rule[1:] for rule in rules if rule.startswith("!")}
    project = wheel["project"]
    build = {"pyproject.toml", "hatch_build.py"}
    assert kept == {*packages, *build, project["readme"], *project["license-files"]}
    # The dependencies' stage makes empty packages of the same names.
    assert any(
        f"for name in {' '.join(sorted(packages))};" in line for line in image("router").lines
    )


def test_no_variable_is_missing_a_default() -> None:
    for path in DEPLOY.glob("compose*.yaml"):
        text = re.sub(r"(?m)#.*$", "", path.read_text())
        assert re.findall(r"\$\{\w+[^:}\w][^}]*\}|\$\{\w+\}|\$\w+", text) == [], path.name
        assert os.environ.get("HOME", "/root") + "/" not in text
