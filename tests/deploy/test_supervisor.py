"""The supervisor against real, tiny processes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from common.errors import EXITS_FOR_GOOD
from deploy import supervisor as supervisor_module
from deploy.errors import DeployError
from deploy.process import Exit, ProcessSpec, describe_code, tail
from deploy.supervisor import SignalEscalation, Supervisor

QUICK = SignalEscalation(interrupt=0.5, terminate=0.5, kill=2.0)

OBEDIENT = """
import sys, time
print("up", flush=True)
try:
    time.sleep(60)
except KeyboardInterrupt:
    print("bye", flush=True)
    sys.exit(0)
"""
DEAF = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("up", flush=True)
time.sleep(60)
"""
STUBBORN = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
def end(*_):
    print("terminated", flush=True)
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
print("up", flush=True)
time.sleep(60)
"""
FAILING = """
import sys
print("about to fail", flush=True)
print("the reason", file=sys.stderr)
sys.exit(3)
"""
LITTERING = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
print("child", child.pid, flush=True)
time.sleep(60)
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], str]:
    """Write a module that supervised processes can run by name."""
    code = tmp_path / "code"
    code.mkdir()
    path = f"{code}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    monkeypatch.setenv("PYTHONPATH", path)

    def write(name: str, text: str) -> str:
        (code / f"{name}.py").write_text(text)
        return name

    return write


def until(condition: Callable[[], bool], patience: float = 20.0) -> None:
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def running(pid: int) -> bool:
    """Whether ``pid`` exists and is not merely waiting to be reaped."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state not in {"Z", "X"}


def test_stops_at_the_first_signal_and_keeps_the_output(
    module: Callable[[str, str], str], tmp_path: Path
) -> None:
    supervisor = Supervisor([ProcessSpec("a", module("fake_a", OBEDIENT))], tmp_path / "logs")
    with supervisor:
        until(lambda: tail(supervisor.log_path("a")) == ("up",))
        pid = supervisor.pid("a")
        assert supervisor.alive("a")
    assert not running(pid)
    assert tail(supervisor.log_path("a")) == ("up", "bye")


@pytest.mark.parametrize(("code", "last"), [(STUBBORN, "terminated"), (DEAF, "up")])
def test_escalation_ends_those_that_ignore_signals(
    module: Callable[[str, str], str], tmp_path: Path, code: str, last: str
) -> None:
    supervisor = Supervisor(
        [ProcessSpec("a", module("fake_b", code))], tmp_path / "logs", escalation=QUICK
    )
    with supervisor:
        until(lambda: tail(supervisor.log_path("a")) == ("up",))
        pid = supervisor.pid("a")
    assert not running(pid)
    assert tail(supervisor.log_path("a"))[-1] == last


@pytest.mark.parametrize("code", sorted(EXITS_FOR_GOOD))
def test_what_would_end_so_again_is_not_started_again(
    module: Callable[[str, str], str], tmp_path: Path, code: int
) -> None:
    name = module("fake_refused", f"import sys\nsys.exit({code})\n")
    spec = ProcessSpec("refused", name, restart=True)
    with Supervisor([spec], tmp_path / "logs") as supervisor:
        until(lambda: not supervisor.alive("refused"))
        (ended,) = supervisor.poll()
        assert (ended.code, ended.restarted) == (code, False)
        assert supervisor.running() == []


def test_reports_a_death_with_code_and_last_words(
    module: Callable[[str, str], str], tmp_path: Path
) -> None:
    spec = ProcessSpec("broken", module("fake_c", FAILING))
    with Supervisor([spec], tmp_path / "logs") as supervisor:
        until(lambda: not supervisor.alive("broken"))
        (ended,) = supervisor.poll()
        assert supervisor.poll() == []
    assert (ended.name, ended.code, ended.expected) == ("broken", 3, False)
    assert set(ended.tail) == {"about to fail", "the reason"}
    assert "exit code 3" in ended.describe()
    assert "the reason" in ended.describe()


def test_a_process_that_may_finish_is_expected_to(
    module: Callable[[str, str], str], tmp_path: Path
) -> None:
    done = ProcessSpec("done", module("fake_d", "print('ok')"), may_finish=True)
    failed = ProcessSpec("failed", module("fake_e", FAILING), may_finish=True)
    with Supervisor([done, failed], tmp_path / "logs") as supervisor:
        until(lambda: not supervisor.alive("done") and not supervisor.alive("failed"))
        expected = {ended.name: ended.expected for ended in supervisor.poll()}
    assert expected == {"done": True, "failed": False}


def test_restarts_after_a_failure_up_to_the_limit(
    module: Callable[[str, str], str], tmp_path: Path
) -> None:
    spec = ProcessSpec("again", module("fake_f", FAILING), restart=True, max_restarts=2)
    ends: list[Exit] = []
    with Supervisor([spec], tmp_path / "logs") as supervisor:
        while not ends or ends[-1].restarted:
            ends += supervisor.poll()
            time.sleep(0.02)
    assert [ended.restarted for ended in ends] == [True, True, False]
    assert tail(supervisor.log_path("again")).count("about to fail") == 3


SPARED = """
import os, sys, time
from {slow} import value
if __name__ == "__main__":
    print("up", os.getpid(), sys.stdin.read(), *sys.argv[1:], flush=True)
    time.sleep(60)
"""
SLOW = """
import time
print("importing", flush=True)
time.sleep(1.5)
value = 1
"""


def spared(module: Callable[[str, str], str], **options: Any) -> ProcessSpec:
    """A process whose import takes 1.5 s and that wants a spare."""
    slow = module("fake_slow", SLOW)
    name = module("fake_spared", SPARED.format(slow=slow))
    return ProcessSpec("s", name, ("arg",), restart=True, spare=True, **options)


def lines_of(supervisor: Supervisor, word: str) -> list[str]:
    return [line for line in tail(supervisor.log_path("s")) if line.startswith(word)]


def test_a_spare_takes_over_without_importing(
    module: Callable[[str, str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor_module, "SPARE_AFTER_S", 0.0)
    with Supervisor([spared(module)], tmp_path / "logs", escalation=QUICK) as supervisor:
        until(lambda: len(lines_of(supervisor, "up")) == 1)
        assert supervisor.poll() == []
        spare = supervisor.spare_pid("s")
        assert spare is not None
        until(lambda: len(lines_of(supervisor, "importing")) == 2)
        time.sleep(2.0)
        assert len(lines_of(supervisor, "up")) == 1
        killed = time.monotonic()
        os.kill(supervisor.pid("s"), signal.SIGKILL)
        until(lambda: any(ended.restarted for ended in supervisor.poll()))
        assert supervisor.pid("s") == spare
        until(lambda: len(lines_of(supervisor, "up")) == 2)
        assert time.monotonic() - killed < 1.0
        assert lines_of(supervisor, "up")[1].split() == ["up", str(spare), "arg"]
        # The next one is prepared, too.
        until(lambda: supervisor.poll() == [] and supervisor.spare_pid("s") not in {None, spare})
        last = supervisor.spare_pid("s")
    assert last is not None
    assert not running(spare)
    assert not running(last)


def test_without_a_spare_that_lives_a_new_process_is_started(
    module: Callable[[str, str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor_module, "SPARE_AFTER_S", 0.0)
    with Supervisor([spared(module)], tmp_path / "logs", escalation=QUICK) as supervisor:
        until(lambda: len(lines_of(supervisor, "up")) == 1)
        supervisor.poll()
        spare = supervisor.spare_pid("s")
        assert spare is not None
        os.kill(spare, signal.SIGKILL)
        until(lambda: not running(spare))
        os.kill(supervisor.pid("s"), signal.SIGKILL)
        until(lambda: any(ended.restarted for ended in supervisor.poll()))
        assert supervisor.pid("s") != spare
        until(lambda: len(lines_of(supervisor, "up")) == 2)


@pytest.mark.parametrize("options", [{"max_restarts": 0}, {"foreground": True}])
def test_no_spare_where_it_would_not_be_used(
    module: Callable[[str, str], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: dict[str, Any],
) -> None:
    monkeypatch.setattr(supervisor_module, "SPARE_AFTER_S", 0.0)
    specs = [spared(module, **options)]
    with Supervisor(specs, tmp_path / "logs", escalation=QUICK) as supervisor:
        assert supervisor.poll() == []
        assert supervisor.spare_pid("s") is None


def test_unwanted_processes_are_not_started(tmp_path: Path) -> None:
    with Supervisor([ProcessSpec("no", "no_such", enabled=False)], tmp_path / "l") as supervisor:
        assert not supervisor.alive("no")
        assert supervisor.poll() == []


def test_processes_stop_in_their_order(module: Callable[[str, str], str], tmp_path: Path) -> None:
    code = OBEDIENT.replace('print("bye", flush=True)', "print(time.monotonic_ns(), flush=True)")
    name = module("fake_g", code)
    specs = [ProcessSpec("last", name, stop_order=1), ProcessSpec("first", name)]
    supervisor = Supervisor(specs, tmp_path / "logs")
    with supervisor:
        for spec in specs:
            until(lambda spec=spec: tail(supervisor.log_path(spec.name)) == ("up",))  # type: ignore[misc]
    ended = {spec.name: int(tail(supervisor.log_path(spec.name))[-1]) for spec in specs}
    assert ended["first"] < ended["last"]


def test_what_a_service_started_goes_with_it(
    module: Callable[[str, str], str], tmp_path: Path
) -> None:
    spec = ProcessSpec("litter", module("fake_h", LITTERING))
    with Supervisor([spec], tmp_path / "logs", escalation=QUICK) as supervisor:
        until(lambda: len(tail(supervisor.log_path("litter"))) == 1)
        grandchild = int(tail(supervisor.log_path("litter"))[0].split()[1])
        os.kill(supervisor.pid("litter"), signal.SIGKILL)
        until(lambda: bool(supervisor.poll()))
        until(lambda: not running(grandchild))


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's tie to the parent is Linux's")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_nothing_outlives_the_supervisor(
    module: Callable[[str, str], str], tmp_path: Path, number: signal.Signals
) -> None:
    fakes = [module("fake_i", OBEDIENT), module("fake_j", DEAF)]
    script = f"""
import sys, time
from pathlib import Path
from common.program import signals_as_keyboard_interrupt
from deploy.process import ProcessSpec, tail
from deploy.supervisor import SignalEscalation, Supervisor
specs = [ProcessSpec(name, name) for name in {fakes!r}]
quick = SignalEscalation(0.5, 0.5, 2.0)
supervisor = Supervisor(specs, Path({str(tmp_path / "logs")!r}), escalation=quick)
with signals_as_keyboard_interrupt(), supervisor:
    while not all(tail(supervisor.log_path(spec.name)) for spec in specs):
        time.sleep(0.02)
    print(*[supervisor.pid(spec.name) for spec in specs], flush=True)
    time.sleep(60)
"""
    process = subprocess.Popen(
        # As a shell script's background process: SIGINT ignored from birth.
        ["sh", "-c", 'trap \'\' INT; exec "$0" -c "$1"', sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    try:
        pids = [int(word) for word in process.stdout.readline().split()]
        assert len(pids) == 2
        assert all(running(pid) for pid in pids)
        process.send_signal(number)
        process.wait(timeout=20)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    until(lambda: not any(running(pid) for pid in pids), patience=5.0)


def test_names_must_be_unique(tmp_path: Path) -> None:
    with pytest.raises(DeployError, match="unique"):
        Supervisor([ProcessSpec("a", "m"), ProcessSpec("a", "m")], tmp_path)


def test_unwritable_log_directory_is_named(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(DeployError, match=r"cannot create the log directory .*file/logs"):
        Supervisor([], blocker / "logs").start()


def test_codes_in_words() -> None:
    assert describe_code(0) == "exit code 0"
    assert describe_code(-9) == "killed by SIGKILL"
