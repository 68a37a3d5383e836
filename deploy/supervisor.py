"""Start, watch and stop the services of one system, each a process of its own.

The supervisor is a plain object that its owner polls; it has no thread, because the kernel ties a
child's life to the thread that started it (see :mod:`deploy.child`). Start and poll it from one
thread that lives as long as the system, as a rule the main thread.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

from deploy.errors import DeployError
from deploy.process import Exit, ProcessSpec, Restart, tail


@dataclass
class _Child:
    spec: ProcessSpec
    process: "subprocess.Popen[bytes]"
    restarts: int = 0
    exit: Exit | None = None


@dataclass(frozen=True)
class SignalEscalation:
    """How long each signal gets before the next, harsher one [s]."""

    interrupt: float = 5.0
    terminate: float = 2.0
    kill: float = 2.0


@dataclass
class Supervisor:
    """Runs a list of processes.

    Use as a context manager: leaving the block, by whatever way, stops everything.

    Attributes:
        specs: what to run, in starting order; names are unique.
        log_dir: where each background process's output goes.
        environment: variables set for every process on top of this one's.
        ladder: patience at each rung of SIGINT, SIGTERM, SIGKILL.
    """

    specs: Sequence[ProcessSpec]
    log_dir: Path
    environment: Mapping[str, str] = field(default_factory=dict)
    ladder: SignalEscalation = SignalEscalation()
    _children: dict[str, _Child] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        names = [spec.name for spec in self.specs]
        if len(set(names)) != len(names):
            raise DeployError(f"process names must be unique, got {names}")

    def __enter__(self) -> "Supervisor":
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Start every wanted process.

        Raises:
            DeployError: the log directory cannot be written.
        """
        try:
            self.log_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DeployError(
                f"cannot create the log directory {self.log_dir}: {error.strerror}; "
                "choose another run directory"
            ) from error
        for spec in self.specs:
            if spec.wanted:
                self._children[spec.name] = _Child(spec, self._spawn(spec))

    def log_path(self, name: str) -> Path:
        """Where the output of process ``name`` goes."""
        return self.log_dir / f"{name}.txt"

    def alive(self, name: str) -> bool:
        """Whether process ``name`` was started and has not ended."""
        child = self._children.get(name)
        return child is not None and child.process.poll() is None

    def pid(self, name: str) -> int:
        """Process id of ``name``, which must have been started."""
        return self._children[name].process.pid

    def spec(self, name: str) -> ProcessSpec:
        """The declaration of process ``name``, which must have been started."""
        return self._children[name].spec

    def running(self) -> list[str]:
        """Names of the processes that run, in starting order."""
        return [name for name in self._children if self.alive(name)]

    def exit_of(self, name: str) -> Exit | None:
        """How ``name`` ended, or None while it runs (or was never started)."""
        child = self._children.get(name)
        return None if child is None else child.exit

    def poll(self) -> list[Exit]:
        """Reap processes that ended on their own since the last poll; restart those that should.

        Never blocks.
        """
        exits = []
        for child in self._children.values():
            code = child.process.poll()
            if code is None or child.exit is not None:
                continue
            exits.append(self._reap(child, code))
        return exits

    def stop(self) -> None:
        """Stop everything, wave by wave, up the ladder; returns when no process is left.

        A further Ctrl-C meanwhile skips to the next rung.
        """
        waves = sorted({child.spec.stop_order for child in self._children.values()})
        for wave in waves:
            self._stop_together(
                [
                    child
                    for child in self._children.values()
                    if child.spec.stop_order == wave and child.exit is None
                ]
            )

    def _spawn(self, spec: ProcessSpec) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "deploy.child", str(os.getpid()), spec.module, *spec.args]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", **self.environment}
        if spec.foreground:
            return subprocess.Popen(command, env=environment)
        with self._open_log(spec) as log:
            return subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,
            )

    def _open_log(self, spec: ProcessSpec) -> IO[bytes]:
        path = self.log_path(spec.name)
        try:
            return path.open("ab")
        except OSError as error:
            raise DeployError(f"cannot write {path}: {error.strerror}") from error

    def _reap(self, child: _Child, code: int) -> Exit:
        _sweep(child)
        spec = child.spec
        expected = spec.may_finish and code == 0
        again = (
            spec.restart is Restart.ON_FAILURE and code != 0 and child.restarts < spec.max_restarts
        )
        said = () if spec.foreground else tail(self.log_path(spec.name))
        ended = Exit(spec.name, code, expected, again, said)
        if again:
            child.restarts += 1
            child.process = self._spawn(spec)
        else:
            child.exit = ended
        return ended

    def _stop_together(self, children: Sequence[_Child]) -> None:
        rungs = (
            (signal.SIGINT, self.ladder.interrupt),
            (signal.SIGTERM, self.ladder.terminate),
            (signal.SIGKILL, self.ladder.kill),
        )
        for number, patience in rungs:
            running = [child for child in children if child.process.poll() is None]
            if not running:
                break
            for child in running:
                _send(child, number)
            _wait(running, patience)
        for child in children:
            _sweep(child)


def _send(child: _Child, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        if child.spec.foreground:
            child.process.send_signal(number)
        else:
            os.killpg(child.process.pid, number)


def _sweep(child: _Child) -> None:
    """Kill what an ended process left behind in its group (it should leave nothing).

    Called as soon as the end is noticed: later the group's number may belong to someone else.
    """
    if not child.spec.foreground:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.process.pid, signal.SIGKILL)


def _wait(children: Sequence[_Child], patience: float) -> None:
    """Wait until all ended or ``patience`` [s] is over; Ctrl-C ends the wait, not the stop."""
    deadline = time.monotonic() + patience
    with contextlib.suppress(KeyboardInterrupt):
        while time.monotonic() < deadline:
            if all(child.process.poll() is not None for child in children):
                return
            time.sleep(0.02)
