"""A recorder connected as a client finds the robot and its topics, and publishes nothing."""

import ast
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import services.logger
from common.schemas import EpisodeAction, Gait, GaitRequest
from common.topics import CAMERA_LEFT, EPISODE, HEALTH, TELEOP_GAIT
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.schema_query import Description, SchemaServer, discover
from common.transport.session import open_session
from common.transport.tap import RawSample
from common.wire.header import wire_header
from deploy.ports import reserve_base_port
from lab.errors import LabError
from lab.logs.mark import mark
from services.logger.errors import LoggerError
from services.logger.read.index import read_index
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.record import service
from services.logger.record.attach import find_robot
from services.logger.record.config import LoggerConfig
from services.logger.record.intake import Intake
from services.logger.record.service import RecordingOptions, record
from services.logger.repair.verify import fault_of


@pytest.fixture
def bus() -> Iterator[BusConfig]:
    with reserve_base_port() as port:
        yield BusConfig(base_port=port)


@pytest.fixture
def robot(bus: BusConfig) -> Iterator[Any]:
    """A plant that describes itself, publishes gaits, and a topic that is in no table."""
    session: Any = open_session(bus, "sim")
    server = SchemaServer(session, "draco3", "sim", (TELEOP_GAIT, CAMERA_LEFT))
    newer = {
        "draco3/arm/pose": {"tag": "trill/ArmPose/3;abc", "jsonschema": '{"title": "ArmPose"}'}
    }
    import msgpack

    def reply(query: Any) -> None:
        with query:
            query.reply("draco3/schema/arm", msgpack.packb(newer))

    queryable = session.declare_queryable("draco3/schema/arm", reply)
    yield session
    queryable.undeclare()
    server.close()
    session.close()


def guest(bus: BusConfig) -> BusConfig:
    """As a client of the plant's own port, knowing no name."""
    return BusConfig(mode="client", connect=(f"tcp/127.0.0.1:{bus.base_port}",))


class Spy:
    """A session that notes what is declared on it."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self.declared: list[tuple[str, str]] = []

    def __getattr__(self, name: str) -> Any:
        inner = getattr(self._session, name)
        if not name.startswith(("declare_", "put", "delete")):
            return inner

        def noted(key: Any, *args: Any, **kwargs: Any) -> Any:
            self.declared.append((name, str(key)))
            return inner(key, *args, **kwargs)

        return noted


class Running:
    """A recorder in a thread of this process, stopped when the context is left."""

    def __init__(self, options: RecordingOptions, monkeypatch: pytest.MonkeyPatch) -> None:
        self.spies: list[Spy] = []

        def opened(*args: Any) -> Spy:
            self.spies.append(Spy(open_session(*args)))
            return self.spies[-1]

        monkeypatch.setattr(service, "open_session", opened)
        self._stop = threading.Event()
        self.report: Any = None
        self.error: Exception | None = None
        self._options = options
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            self.report = record(self._options, self._stop.is_set)
        except Exception as error:  # noqa: BLE001 - shown by the test
            self.error = error

    def __enter__(self) -> "Running":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(30)

    def declared(self, what: str) -> set[str]:
        return {key for spy in self.spies for name, key in spy.declared if name == what}


def send_until(condition: Any, *senders: Any) -> None:
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        for send in senders:
            send()
        time.sleep(0.02)


def test_a_service_describes_what_it_publishes(bus: BusConfig, robot: Any) -> None:
    asking: Any = open_session(guest(bus), "logger")
    found = discover(asking)
    assert set(found) == {"draco3"}
    assert set(found["draco3"]) == {"draco3/teleop/gait", "draco3/camera/left", "draco3/arm/pose"}
    one = found["draco3"]["draco3/teleop/gait"]
    assert one.name == "GaitRequest/1"
    assert "request_id" in json.loads(one.jsonschema)["properties"]
    assert discover(asking, "r2") == {}
    asking.close()


def test_answers_that_are_none_are_passed_over(bus: BusConfig, robot: Any) -> None:
    def reply(query: Any) -> None:
        with query:
            query.reply("draco3/schema/odd", b"\xc1 no msgpack")

    queryable = robot.declare_queryable("draco3/schema/odd", reply)
    asking: Any = open_session(guest(bus), "logger")
    assert len(discover(asking)["draco3"]) == 3
    asking.close()
    queryable.undeclare()
    assert Description(tag="", jsonschema="{}").name == "unnamed"


def test_two_robots_have_to_be_chosen_from_and_none_is_said(bus: BusConfig) -> None:
    session: Any = open_session(bus, "sim")
    asking: Any = open_session(guest(bus), "logger")
    with pytest.raises(LoggerError, match="no robot answers at here"):
        find_robot(asking, "here", timeout=0.2)
    servers = [SchemaServer(session, "r1", "sim", (HEALTH,))]
    assert find_robot(asking, "here") == "r1"
    servers.append(SchemaServer(session, "r2", "sim", (HEALTH,)))
    with pytest.raises(LoggerError, match=r"2 robots answer at here: r1, r2; choose .*--robot"):
        find_robot(asking, "here")
    for server in servers:
        server.close()
    asking.close()
    session.close()


def test_a_client_finds_the_robot_and_its_schemas_and_publishes_nothing(
    bus: BusConfig, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.mcap"
    gaits = Publisher(robot, "draco3", TELEOP_GAIT, "teleop", 5)
    encoding = "application/msgpack;trill/ArmPose/3;abc"
    options = RecordingOptions(guest(bus), log, LoggerConfig(), observe=True, find_robot=True)
    with Running(options, monkeypatch) as running:
        send_until(
            lambda: running.error or (log.exists() and log.stat().st_size > 3000),
            lambda: gaits.send(GaitRequest(request_id=1, gait=Gait.FORWARD)),
            lambda: robot.put("draco3/arm/pose", b"\x80", encoding=encoding),
        )
    assert running.error is None
    assert running.report["draco3/teleop/gait"].recorded > 0
    schemas = {one.key: one.schemas for one in read_info(log).topics}
    assert schemas["draco3/teleop/gait"] == ("GaitRequest/1",)
    assert schemas["draco3/arm/pose"] == ("ArmPose/3",)
    described = {one.name: one.data for one in read_index(log).schemas.values()}
    assert described["ArmPose/3"] == b'{"title": "ArmPose"}'
    assert running.declared("declare_publisher") == set()
    assert running.declared("put") == running.declared("delete") == set()
    (answers,) = running.declared("declare_queryable")
    assert answers.startswith("draco3/episodes/")


def test_a_recorder_that_can_receive_no_more_ends_with_an_error(
    bus: BusConfig, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.mcap"
    gaits = Publisher(robot, "draco3", TELEOP_GAIT, "teleop", 5)
    offer = Intake.offer

    def fail_at_20(intake: Intake, sample: RawSample) -> bool:
        if wire_header(sample.payload).seq == 20:  # type: ignore[union-attr]
            raise ValueError("no such luck")
        return offer(intake, sample)

    monkeypatch.setattr(Intake, "offer", fail_at_20)
    with Running(
        RecordingOptions(bus, log, LoggerConfig(topics=("teleop/*",))), monkeypatch
    ) as running:
        send_until(
            lambda: running.error is not None,
            lambda: gaits.send(GaitRequest(request_id=1, gait=Gait.FORWARD)),
        )
    assert isinstance(running.error, LoggerError)
    assert "ValueError: no such luck" in str(running.error)
    # What arrived before is in a whole file.
    assert fault_of(log) == ""
    assert [one.sequence for one in LogReader(log).raw_messages()][-1] == 19


def test_at_home_the_one_key_it_publishes_is_its_health(
    bus: BusConfig, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.mcap"
    gaits = Publisher(robot, "draco3", TELEOP_GAIT, "teleop", 5)
    with Running(RecordingOptions(bus, log, LoggerConfig()), monkeypatch) as running:
        send_until(
            lambda: running.error or (log.exists() and log.stat().st_size > 3000),
            lambda: gaits.send(GaitRequest(request_id=1, gait=Gait.FORWARD)),
        )
    assert running.error is None
    assert running.declared("declare_publisher") == {"draco3/health/logger"}
    assert running.declared("put") == running.declared("delete") == set()
    assert all(
        key == "draco3/schema/logger" or key.startswith("draco3/episodes/")
        for key in running.declared("declare_queryable")
    )


def test_no_code_of_the_logger_could_publish_anything_else() -> None:
    """The only Publisher is of HEALTH, and nothing is put or declared past it."""
    topics, puts = [], []
    for path in Path(services.logger.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            if isinstance(node.func, ast.Name) and node.func.id == "Publisher":
                topics.append(ast.unparse(node.args[2]))
            if isinstance(node.func, ast.Attribute):
                owner = ast.unparse(node.func.value)
                if node.func.attr == "declare_publisher":
                    puts.append(f"{path.name}: {ast.unparse(node)}")
                if node.func.attr in {"put", "delete"} and "session" in owner:
                    puts.append(f"{path.name}: {ast.unparse(node)}")
    assert topics == ["HEALTH"]
    assert puts == []


def test_excluded_topics_are_not_recorded_and_late_ones_are(
    bus: BusConfig, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "QUERY_PERIOD", 0.3)
    log = tmp_path / "log.mcap"
    gaits = Publisher(robot, "draco3", TELEOP_GAIT, "teleop", 5)
    eye = Publisher(robot, "draco3", HEALTH, "sim", 5)
    encoding = "application/msgpack;trill/ArmPose/3;abc"
    options = RecordingOptions(
        guest(bus), log, LoggerConfig(exclude=("health/**",)), observe=True, find_robot=True
    )
    with Running(options, monkeypatch) as running:
        send_until(
            lambda: running.error or (log.exists() and log.stat().st_size > 4000),
            lambda: gaits.send(GaitRequest(request_id=1, gait=Gait.FORWARD)),
            lambda: robot.put("draco3/arm/pose", b"\x80", encoding=encoding),
            lambda: robot.put("draco3/health/sim", b"\x80"),
        )
    assert running.error is None
    assert {entry.key for entry in LogReader(log).raw_messages()} == {
        "draco3/teleop/gait",
        "draco3/arm/pose",
    }
    assert not any("health" in key for key in running.declared("declare_subscriber"))
    eye.close()


def test_marks_are_numbered_recorded_and_confirmed(
    bus: BusConfig, robot: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lab.logs.mark.TIMEOUT_S", 20.0)
    log = tmp_path / "log.mcap"
    me = guest(bus)
    with Running(RecordingOptions(bus, log, LoggerConfig()), monkeypatch) as running:
        texts = [
            mark(me, EpisodeAction.START, "door"),
            mark(me, EpisodeAction.END),
            mark(me, EpisodeAction.START, "again"),
            mark(me, EpisodeAction.START, "once more"),
            mark(me, EpisodeAction.DISCARD, "slipped"),
        ]
        with pytest.raises(LabError, match="no episode is running"):
            mark(me, EpisodeAction.END)
    assert running.error is None
    assert texts[0].startswith(f"episode 0 started (door) in {log}")
    assert texts[1].startswith("episode 0 ended (door)")
    assert "episode 1 was still running and is interrupted" in texts[3]
    assert [(one.episode, one.label, one.outcome) for one in read_info(log).episodes] == [
        (0, "door", "complete"),
        (1, "again", "interrupted"),
        (2, "slipped", "discarded"),
    ]
    monkeypatch.setattr("lab.logs.mark.TIMEOUT_S", 0.3)
    with pytest.raises(LabError, match="no recorder of draco3 answers"):
        mark(me, EpisodeAction.START)
    assert EPISODE.name == "episode"
