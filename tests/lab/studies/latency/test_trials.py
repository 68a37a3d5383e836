"""Real trials: run by the command, and read back from a log."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common.schemas import (
    Header,
    Message,
    PlantAction,
    PlantRequest,
    TaskStage,
    TaskStatus,
    TaskVerdict,
    UndesiredContact,
)
from common.topics import PLANT_REQUEST, TASK_STATUS, Topic
from common.wire.header import wire_header
from lab.cli.main import main
from lab.errors import LabError, LatencyStudyError
from lab.studies.latency.conditions import standard
from lab.studies.latency.human_trials import read_trials
from lab.studies.latency.plan import TrialKey
from lab.studies.latency.record import OWN_LATENCY, LinkLatency, StudyTrial
from lab.studies.latency.store import StudyStore
from lab.studies.latency.trial import run_study_trial
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.stack import TaskStack
from services.logger.errors import LoggerError
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from services.teleop.synthetic.traits import TRAITS
from tests.lab.studies.latency.support import UNLOCK, plan_of

SETTINGS = ["--tasks", UNLOCK, "--traits", "steady", "--physics-steps", "5"]
STEADY = SyntheticSpec(traits=TRAITS["steady"])
CONDITIONS = ["--condition", "interpolation", "--condition", "latency-250"]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> StudyStore:
    """Two conditions, one seed, run once."""
    root = tmp_path_factory.mktemp("study")
    words = ["study", "latency", "--episodes", "1", "--jobs", "2", "--out", str(root)]
    assert main([*words, *SETTINGS, *CONDITIONS]) == 0
    return StudyStore(root)


@pytest.fixture(scope="module")
def late(done: StudyStore) -> StudyTrial:
    return next(trial for trial in done.trials() if trial.condition == "latency-250")


def test_latency_is_measured_where_it_was_used(done: StudyStore, late: StudyTrial) -> None:
    prompt = next(trial for trial in done.trials() if trial.condition == "interpolation")
    assert late.verdict == prompt.verdict == "success"
    assert late.time > prompt.time
    assert (prompt.command.asked_mean, late.command.asked_mean) == (0.0, 0.25)
    assert prompt.command.mean is not None
    assert late.command.mean is not None
    # The controller steps every 10 ms.
    assert 0.0 <= prompt.command.mean <= 0.0101
    assert 0.25 <= late.command.mean <= 0.2601
    # 20 set-points a second, from when the robot stands.
    assert 20 * (late.time - 2.0) < late.command.used < 20 * late.simulated
    assert late.feedback.mean is not None
    assert late.feedback.mean < 0.01
    assert late.hand_path is not None
    assert 0.3 < late.hand_path < 5.0
    assert late.arm_acceleration is not None
    assert late.arm_acceleration > 0.0


def test_it_leaves_tables_and_figure(done: StudyStore) -> None:
    assert {"trials.csv", "summary.csv", "summary.json", "latency.png", "study.json"} <= {
        path.name for path in done.root.iterdir()
    }


def test_the_same_command_finds_nothing_to_do(
    done: StudyStore, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (done.root / "trials.jsonl").read_bytes()
    words = ["study", "latency", "--episodes", "1", "--out", str(done.root)]
    assert main([*words, *SETTINGS, *CONDITIONS]) == 0
    assert (done.root / "trials.jsonl").read_bytes() == before
    assert main([*words, *CONDITIONS, "--tasks", UNLOCK]) == 2
    assert "begun with other settings" in capsys.readouterr().err


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The late trial once more, recorded as a run is."""
    folder = tmp_path_factory.mktemp("run")
    plan = plan_of(*standard("command"), tasks=(UNLOCK,), operator=STEADY, physics_steps=5)
    stack = TaskStack(plan.spec(TrialKey(0, UNLOCK, "latency-250")), record=True)
    stack.run()
    stack.runner.close()
    sink = McapSink(folder / "log.mcap", "draco3", LoggerConfig())
    for sample in stack.runner.log:
        sink.write(sample, wire_header(sample.payload))
    sink.close()
    return folder


def test_a_log_gives_the_same_trial(log: Path, late: StudyTrial) -> None:
    (trial,) = read_trials(LogReader(log / "log.mcap"), "P01", standard("command")[2])
    assert (trial.operator, trial.participant, trial.condition) == ("human", "P01", "latency-250")
    assert (trial.task, trial.seed, trial.limit) == (late.task, late.seed, late.limit)
    assert (trial.verdict, trial.time, trial.reason) == (late.verdict, late.time, late.reason)
    assert (trial.stages, trial.undesired, trial.reached) == (late.stages, late.undesired, True)
    assert trial.command.mean == pytest.approx(late.command.mean, abs=0.001)
    # The other goes on for half a second after the verdict.
    assert trial.hand_path == pytest.approx(late.hand_path, rel=0.2)
    assert trial.arm_acceleration == pytest.approx(late.arm_acceleration, rel=0.2)


def test_a_persons_log_is_taken_in_once(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = str(tmp_path / "study")
    assert main(["study", "latency", "--episodes", "0", "--out", root]) == 0
    words = ["study", "add", str(log), "--condition", "latency-250", "--out", root]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--participant", "Jane Doe"])
    assert ended.value.code == 2
    assert main([*words, "--participant", "P01"]) == 0
    assert "requested 250 ms, measured 25" in capsys.readouterr().out
    assert main([*words, "--participant", "P01"]) == 0
    assert "there already" in capsys.readouterr().out
    assert main(["study", "latency", "--report", root]) == 0
    assert "human" in capsys.readouterr().out
    store = StudyStore(Path(root))
    assert [trial.key for trial in store.human_trials()] == [("P01", UNLOCK, "latency-250", 0)]
    assert store.trials() == []


def test_a_log_that_two_commands_add_at_once_is_taken_in_once(log: Path, tmp_path: Path) -> None:
    root = str(tmp_path / "study")
    assert main(["study", "latency", "--episodes", "0", "--out", root]) == 0
    words = ["study", "add", str(log), "--condition", "latency-250", "--participant", "P01"]
    command = [sys.executable, "-m", "lab.cli", *words, "--out", root]
    store = StudyStore(Path(root))
    # Nothing can be written until both have come as far as they can.
    with store.adding():
        both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        while not {one.pid for one in both} <= _waiting_for_locks():
            assert all(one.poll() is None for one in both)
            time.sleep(0.05)
    told = "".join(one.communicate()[0] for one in both)
    assert told.count("success at") == told.count("there already") == 1
    assert len(store.human_trials()) == 1


def _waiting_for_locks() -> set[int]:
    """The processes that wait for a lock on a file."""
    lines = Path("/proc/locks").read_text().splitlines()
    return {int(line.split()[5]) for line in lines if "->" in line}


def test_a_log_of_another_condition_is_refused(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = str(tmp_path / "study")
    assert main(["study", "latency", "--episodes", "0", "--out", root]) == 0
    words = ["study", "add", str(log), "--participant", "P01", "--out", root, "--condition"]
    for wrong, asked in (("latency-500", 500), ("interpolation", 0)):
        assert main([*words, wrong]) == 1
        shown = capsys.readouterr().err
        assert f"{wrong} asks for {asked} ms of command latency, measured were 25" in shown
        assert StudyStore(Path(root)).human_trials() == []
    assert main([*words, "latency-500", "--anyway"]) == 0
    assert len(StudyStore(Path(root)).human_trials()) == 1


@pytest.mark.parametrize(
    ("asked", "p99", "mean", "agrees"),
    [
        (0.25, 0.25, 0.30, True),
        (0.25, 0.25, 0.40, False),
        (0.25, 0.25, 0.12, False),
        (0.0, 0.0, 0.04, True),
        (0.0, 0.0, 0.06, False),
        (0.122, 0.9, 0.5, True),
        (0.25, 0.25, None, True),
    ],
)
def test_latencies_agree_with_their_condition(
    asked: float, p99: float, mean: float | None, agrees: bool
) -> None:
    assert (
        LinkLatency(asked_mean=asked, asked_p99=p99, mean=mean).agrees(OWN_LATENCY["command"])
        is agrees
    )


class JudgeLog(LogReader):
    """A log with only the judge's statuses and the requests to the plant."""

    def __init__(self, *messages: TaskStatus | PlantRequest) -> None:
        super().__init__(Path("judge.mcap"))
        self._messages = messages

    def messages(self) -> Iterator[tuple[Topic[Any], Message]]:
        for message in self._messages:
            yield TASK_STATUS if isinstance(message, TaskStatus) else PLANT_REQUEST, message


def status(
    resets: int, verdict: TaskVerdict, time: float, *, goal: bool = False, boot: int = 1
) -> TaskStatus:
    return TaskStatus(
        header=Header(source="sim", boot=boot),
        task=UNLOCK,
        seed=5 + resets,
        time=time,
        limit=20.0,
        verdict=verdict,
        stages=[TaskStage(name="lever pressed", done=True), TaskStage(name="open", done=goal)],
        undesired=[UndesiredContact(name="left wrist on jamb", since=1.0, peak=4.0)],
        reset_count=resets,
    )


def test_every_trial_of_a_log_that_came_to_its_end_counts() -> None:
    log = JudgeLog(
        status(0, TaskVerdict.RUNNING, 1.0),
        status(0, TaskVerdict.PARTIAL, 9.0, goal=True),
        status(0, TaskVerdict.PARTIAL, 9.0, goal=True),
        status(1, TaskVerdict.RUNNING, 3.0),
        status(2, TaskVerdict.FAILURE, 20.0),
        status(3, TaskVerdict.RUNNING, 2.0),
    )
    first, second = read_trials(log, "P01", standard("command")[1])
    assert (first.seed, first.verdict, first.time, first.reached) == (5, "partial", 9.0, True)
    assert (second.seed, second.verdict, second.time, second.reached) == (7, "failure", 20.0, False)
    assert [touch.name for touch in first.undesired] == ["left wrist on jamb"]
    assert first.stages == ("lever pressed", "open")
    assert first.command.mean is None
    with pytest.raises(LatencyStudyError, match="no verdict"):
        read_trials(JudgeLog(status(0, TaskVerdict.RUNNING, 1.0)), "P01", standard("command")[1])


def test_a_plant_that_is_started_anew_begins_a_trial() -> None:
    log = JudgeLog(
        status(0, TaskVerdict.FAILURE, 20.0),
        status(0, TaskVerdict.RUNNING, 1.0, boot=2),
        status(0, TaskVerdict.SUCCESS, 8.0, goal=True, boot=2),
    )
    trials = read_trials(log, "P01", standard("command")[1])
    assert [(trial.verdict, trial.time) for trial in trials] == [
        ("failure", 20.0),
        ("success", 8.0),
    ]


def test_what_passed_before_the_person_came_is_not_theirs() -> None:
    def new_trial(seed: int) -> PlantRequest:
        return PlantRequest(header=Header(source="up"), action=PlantAction.RESET, seed=seed)

    log = JudgeLog(
        status(0, TaskVerdict.FAILURE, 20.0),
        new_trial(5),
        status(0, TaskVerdict.FAILURE, 20.0),
        status(1, TaskVerdict.SUCCESS, 8.0, goal=True),
        # Who comes again is given the next seed, and the trial before was theirs.
        new_trial(7),
        status(2, TaskVerdict.PARTIAL, 9.0, goal=True),
    )
    trials = read_trials(log, "P01", standard("command")[1])
    assert [trial.verdict for trial in trials] == ["success", "partial"]


def test_a_log_that_is_none_is_told(tmp_path: Path) -> None:
    with pytest.raises(LoggerError, match="cannot open"):
        read_trials(LogReader(tmp_path / "log.mcap"), "P01", standard("command")[2])


def test_other_code_runs_no_trial() -> None:
    plan = plan_of(*standard("command"), tasks=(UNLOCK,))
    with pytest.raises(LabError, match="source: abc"):
        run_study_trial(plan, TrialKey(0, UNLOCK, "raw"))
