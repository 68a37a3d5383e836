"""The tables of topics and queries name every key there is, and everybody who uses it."""

import ast
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, cast

import pytest
import zenoh

from common.links.client import set_links
from common.links.spec import LinkSpec
from common.ports import RUN_LIVE, SERVICES, Role
from common.queries import ALL_QUERIES, query_table
from common.runtime.live.components import Component, RunnerContext
from common.runtime.live.runner import LiveRunner
from common.runtime.service import Service
from common.schemas import EpisodeAction
from common.topics import (
    ALL_TOPICS,
    EPISODE,
    ESTOP,
    ESTOP_CLEAR,
    HEALTH,
    HEARTBEAT,
    JOURNAL,
    LINK_CHANGE,
    LISTENERS,
    PLANT_REQUEST,
    topic_table,
)
from common.transport.config import BusConfig
from common.transport.keys import subscription_of, topic_of
from deploy.ports import reserve_base_port
from lab.logs.mark import mark
from lab.monitor.monitor import monitored
from services.logger.record.config import LoggerConfig
from services.logger.record.service import RecordingOptions, record
from services.policy.service import PolicyOperator
from services.policy.serving.inference import InferenceServer
from services.sim.rendering.cameras import CameraService
from services.sim.service import PlantService
from services.teleop.headset.service import HeadsetOperator
from services.teleop.keyboard.service import KeyboardOperator
from services.teleop.scripted.service import ScriptedOperator
from services.teleop.synthetic.service import SyntheticOperator
from services.wbc.service import WbcService
from tests.common.runtime.toys import ToyController, ToyPlant
from tests.services.policy.served import description_of

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 30.0
PUBLISHING = ("declare_publisher", "put", "delete")
QUERYING = ("declare_queryable", "declare_querier", "get")
USES = (*PUBLISHING, *QUERYING, "declare_subscriber", "liveliness")


@dataclass(frozen=True)
class Use:
    """A key expression as it was given to a session."""

    how: str
    key: str


class Spy:
    """A Zenoh session that notes every key expression it is given."""

    def __init__(self, session: Any, uses: set[Use]) -> None:
        self._session, self._uses = session, uses

    def __getattr__(self, name: str) -> Any:
        inner = getattr(self._session, name)
        if name not in USES:
            return inner

        def noted(key: object, *args: Any, **kwargs: Any) -> Any:
            self._uses.add(Use(name, str(key)))
            return inner(key, *args, **kwargs)

        return noted


def in_the_tables(use: Use, robot: str) -> bool:
    """Whether a row allows this use of this key of ``robot``."""
    expression = zenoh.KeyExpr(use.key)
    if use.how in PUBLISHING:
        return topic_of(robot, use.key) is not None
    if use.how in QUERYING:
        keys = [query.key(some, "*") for query in ALL_QUERIES for some in (robot, "*")]
    elif use.how == "declare_subscriber":
        if use.key == f"{robot}/**":
            return True  # a listener
        keys = [subscription_of(robot, topic) for topic in ALL_TOPICS]
    else:
        keys = []
    return any(zenoh.KeyExpr(key).includes(expression) for key in keys)


@pytest.fixture
def uses(monkeypatch: pytest.MonkeyPatch) -> set[Use]:
    """Every use of a key by the sessions opened during the test."""
    found: set[Use] = set()
    real_open = zenoh.open
    monkeypatch.setattr(zenoh, "open", lambda config: Spy(real_open(config), found))
    return found


@contextmanager
def running(task: Callable[[], object], stop: Callable[[], object]) -> Iterator[None]:
    thread = threading.Thread(target=task)
    thread.start()
    try:
        yield
    finally:
        stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@contextmanager
def live(service: Service, bus: BusConfig, *more: Component) -> Iterator[LiveRunner]:
    runner = LiveRunner(service, bus, components=more)
    with running(runner.run, runner.stop):
        yield runner


class NoNetwork:
    """Stands for a network where nobody asks."""

    def run(self, *_frames: object) -> NoReturn:
        raise AssertionError


def until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)


def used(uses: set[Use], how: str, key: str) -> bool:
    return any(use.how == how and zenoh.KeyExpr(key).includes(use.key) for use in set(uses))


def test_a_live_bus_uses_only_keys_of_the_tables(tmp_path: Path, uses: set[Use]) -> None:
    log, stopped = tmp_path / "log.mcap", threading.Event()
    with reserve_base_port() as port:
        bus = BusConfig(base_port=port)
        options = RecordingOptions(bus, log, LoggerConfig(), find_robot=True)
        with (
            live(ToyPlant(period_ns=5_000_000, every=1), bus),
            live(ToyController(trigger=True), bus),
            running(lambda: record(options, stopped.is_set), stopped.set),
            monitored(bus) as monitor,
            closing(InferenceServer(monitor.session, bus.robot, NoNetwork(), description_of())),
        ):
            until(log.exists)
            mark(bus, EpisodeAction.START)
            mark(bus, EpisodeAction.END)
            set_links(monitor.session, bus.robot, {"plant/state": LinkSpec.parse("5ms")})
            until(lambda: used(uses, "declare_querier", "draco3/clock/sim"))
            until(lambda: used(uses, "declare_subscriber", "draco3/heartbeat/sim"))
    assert {use for use in uses if not in_the_tables(use, "draco3")} == set()
    for topic in (HEALTH, HEARTBEAT, JOURNAL, LINK_CHANGE):
        assert used(uses, "declare_publisher", f"draco3/{topic.name}/*")
    assert used(uses, "declare_publisher", "draco3/episode")
    for query in ALL_QUERIES:
        assert used(uses, "declare_queryable", query.key("draco3", "*")), query.name
    assert Use("get", "*/schema/*") in uses
    assert Use("get", "draco3/links/*") in uses
    assert Use("get", "draco3/episodes/*") in uses


class Stranger(Component):
    """Uses keys that no table has."""

    def open(self, context: RunnerContext) -> None:
        session = context.session
        self._declared = (
            session.declare_publisher("draco3/secret/state"),
            session.declare_subscriber("draco3/plant/*", lambda _sample: None),
            session.declare_queryable("draco3/secret/wbc", lambda _query: None),
            # Known, but not for that: topics are not asked for, and queries not published.
            session.declare_querier("draco3/plant/state"),
            session.declare_publisher("draco3/clock/wbc"),
            session.get("draco3/**", lambda _reply: None),
            session.put("draco3/health", b""),
        )


def test_a_key_outside_of_the_tables_is_found(uses: set[Use]) -> None:
    with reserve_base_port() as port, live(ToyController(), BusConfig(base_port=port), Stranger()):
        until(lambda: Use("put", "draco3/health") in uses)
    assert {use for use in uses if not in_the_tables(use, "draco3")} == {
        Use("declare_publisher", "draco3/secret/state"),
        Use("declare_subscriber", "draco3/plant/*"),
        Use("declare_queryable", "draco3/secret/wbc"),
        Use("declare_querier", "draco3/plant/state"),
        Use("declare_publisher", "draco3/clock/wbc"),
        Use("get", "draco3/**"),
        Use("put", "draco3/health"),
    }


def handmade_keys(source: str) -> list[str]:
    """Texts of a source file that begin with a robot's name and a slash, as keys do."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.JoinedStr) or len(node.values) < 2:
            continue
        first, second = node.values[:2]
        if not isinstance(first, ast.FormattedValue) or not isinstance(second, ast.Constant):
            continue
        if ast.unparse(first.value).endswith("robot") and str(second.value).startswith("/"):
            found.append(ast.unparse(node))
    return found


MADE_BY_HAND = {
    "common/queries.py": 1,  # the key of a query
    "common/transport/keys.py": 5,  # the keys of a topic
    "common/transport/tap.py": 1,  # everything, for a listener
    "services/logger/record/selection.py": 2,  # everything, or a pattern that a person gave
    "services/logger/record/files.py": 2,  # the same in a message
    "lab/logs/playback.py": 2,  # keys of a recording, under another robot's name
}


def test_no_code_makes_keys_past_the_tables() -> None:
    found = {}
    for room in ("common", "services", "lab", "deploy"):
        for path in (ROOT / room).rglob("*.py"):
            if keys := handmade_keys(path.read_text(encoding="utf-8")):
                found[path.relative_to(ROOT).as_posix()] = len(keys)
    assert found == MADE_BY_HAND
    assert len(handmade_keys('key = f"{context.robot}/{name}"\nother = f"{robot}/clock/*"')) == 2


def role_of(service: type[Service]) -> Role:
    return next(known.role for known in SERVICES if known.name == service.name)


SERVICE_CLASSES: tuple[type[Service], ...] = (
    PlantService,
    CameraService,
    WbcService,
    ScriptedOperator,
    SyntheticOperator,
    KeyboardOperator,
    HeadsetOperator,
    PolicyOperator,
)
FROM_TOOLS = {(topic.name, Role.TOOL) for topic in (EPISODE, PLANT_REQUEST, ESTOP, ESTOP_CLEAR)}
"""`trill mark`, `trill reset`, `trill stop`, `trill resume`, and `trill up` for a new operator."""


def test_the_table_names_those_who_publish_a_topic_and_no_other() -> None:
    runners = (HEALTH, HEARTBEAT, JOURNAL, LINK_CHANGE)
    known = {(topic.name, role) for topic in runners for role in RUN_LIVE} | FROM_TOOLS
    for service in SERVICE_CLASSES:
        known |= {(topic.name, role_of(service)) for topic in service.writes}
    # Published only with a task, so not in the class's own tuple.
    known |= {("task/status", Role.PLANT), ("task/scene", Role.PLANT)}
    # Not stepped by a runner.
    known.add((HEALTH.name, Role.OBSERVER))
    assert {(topic.name, role) for topic in ALL_TOPICS for role in topic.publishers} == known


def test_the_table_names_those_who_read_a_topic_and_no_other() -> None:
    known = {(HEARTBEAT.name, role) for role in RUN_LIVE}
    for service in SERVICE_CLASSES:
        known |= {(topic.name, role_of(service)) for topic in service.reads}
    assert {(topic.name, role) for topic in ALL_TOPICS for role in topic.readers} == known
    assert not any(role in topic.readers for topic in ALL_TOPICS for role in LISTENERS)


def test_keys_are_different_and_printed() -> None:
    names = [topic.name for topic in ALL_TOPICS] + [query.name for query in ALL_QUERIES]
    assert len(set(names)) == len(names)
    text = topic_table() + query_table()
    for name in names:
        assert f"`{name}`" in text or f"`{name}/<" in text
    query = ALL_QUERIES[0]
    assert query.key("r2", "wbc") == f"r2/{query.name}/wbc"
    assert topic_of("r2", query.key("r2", "wbc")) is None
    assert cast(Any, topic_of("r2", "r2/health/wbc")) is HEALTH
