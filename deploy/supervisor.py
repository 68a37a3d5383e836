"""Start, watch, restart and stop the services of one system, each in a process of its own.

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

from common.errors import EXITS_FOR_GOOD
from deploy.child import SPARE
from deploy.errors import DeployError
from deploy.process import Exit, ProcessSpec, tail

SPARE_AFTER_S = 3.0
"""A spare is started when its service has run for this long, so that it does not slow the start
of the system, and a service that fails at once does not get one [s]."""

Process = subprocess.Popen[bytes]


@dataclass
class _Child:
    spec: ProcessSpec
    process: Process
    started: float
    restarts: int = 0
    spare: Process | None = None
    exit: Exit | None = None

    @property
    def restartable(self) -> bool:
        """Whether it would be started again if it failed now."""
        return self.spec.restart and self.restarts < self.spec.max_restarts and self.exit is None


@dataclass(frozen=True)
class SignalEscalation:
    """Time that each signal gets before the next, harsher one [s]."""

    interrupt: float = 5.0
    terminate: float = 2.0
    kill: float = 2.0


@dataclass
class Supervisor:
    """Runs a list of processes.

    Use as a context manager: leaving the block, by whatever way, stops everything.

    Attributes:
        specs: what to run, in starting order; names are unique.
        log_dir: directory for the output of each background process.
        environment: variables set for every process on top of this one's.
        escalation: time given to each of SIGINT, SIGTERM and SIGKILL.
    """

    specs: Sequence[ProcessSpec]
    log_dir: Path
    environment: Mapping[str, str] = field(default_factory=dict)
    escalation: SignalEscalation = SignalEscalation()
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
        """Start every enabled process.

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
            if spec.enabled:
                process = self._spawn(spec)
                self._children[spec.name] = _Child(spec, process, time.monotonic())

    def log_path(self, name: str) -> Path:
        """Return the log file of process ``name``."""
        return self.log_dir / f"{name}.txt"

    def alive(self, name: str) -> bool:
        """Return whether process ``name`` was started and has not ended."""
        child = self._children.get(name)
        return child is not None and child.process.poll() is None

    def pid(self, name: str) -> int:
        """Return the process id of ``name``, which must have been started."""
        return self._children[name].process.pid

    def spare_pid(self, name: str) -> int | None:
        """Return the process id of the spare of ``name``; None while there is none."""
        spare = self._children[name].spare
        return None if spare is None else spare.pid

    def running(self) -> list[str]:
        """Return the names of the processes that run, in starting order."""
        return [name for name in self._children if self.alive(name)]

    def poll(self) -> list[Exit]:
        """Restart failed processes and keep spares ready; call it many times a second.

        Never blocks.

        Returns:
            the processes that ended on their own since the last poll.
        """
        exits = []
        for child in self._children.values():
            code = child.process.poll()
            if code is not None and child.exit is None:
                exits.append(self._reap(child, code))
        for child in self._children.values():
            self._keep_spare(child)
        return exits

    def stop(self) -> None:
        """Stop everything in the order of ``stop_order``; returns when no process is left.

        A further Ctrl-C meanwhile skips to the next signal.
        """
        for child in self._children.values():
            _discard_spare(child)
        for order in sorted({child.spec.stop_order for child in self._children.values()}):
            self._stop_together(
                [
                    child
                    for child in self._children.values()
                    if child.spec.stop_order == order and child.exit is None
                ]
            )

    def _spawn(self, spec: ProcessSpec, *, spare: bool = False) -> Process:
        command = [
            *(sys.executable, "-m", "deploy.child", *([SPARE] if spare else [])),
            *(str(os.getpid()), spec.module, *spec.args),
        ]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", **self.environment}
        if spec.foreground:
            return subprocess.Popen(command, env=environment)
        with self._open_log(spec) as log:
            return subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.PIPE if spare else subprocess.DEVNULL,
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
        again = code != 0 and code not in EXITS_FOR_GOOD and child.restartable
        if again:
            # The successor first: everything else can wait for it.
            self._restart(child)
        lines = () if spec.foreground else tail(self.log_path(spec.name))
        ended = Exit(spec.name, code, expected, again, lines, spec.essential)
        if not again:
            child.exit = ended
            _discard_spare(child)
        return ended

    def _restart(self, child: _Child) -> None:
        """Put the spare in the place of an ended process, or a new process if there is none."""
        spare, child.spare = child.spare, None
        child.restarts += 1
        child.process = spare if spare and _wake(spare) else self._spawn(child.spec)
        child.started = time.monotonic()

    def _keep_spare(self, child: _Child) -> None:
        """Start a spare for a process that wants one, has none and has run for a while.

        A spare that ended is not replaced before the next restart, since a new one would end, too.
        """
        wanted = child.spec.spare and not child.spec.foreground and child.restartable
        settled = time.monotonic() - child.started > SPARE_AFTER_S
        if wanted and settled and child.spare is None:
            child.spare = self._spawn(child.spec, spare=True)

    def _stop_together(self, children: Sequence[_Child]) -> None:
        steps = (
            (signal.SIGINT, self.escalation.interrupt),
            (signal.SIGTERM, self.escalation.terminate),
            (signal.SIGKILL, self.escalation.kill),
        )
        for number, patience in steps:
            running = [child for child in children if child.process.poll() is None]
            if not running:
                break
            for child in running:
                _send(child, number)
            _wait(running, patience)
        for child in children:
            _sweep(child)


def _wake(spare: Process) -> bool:
    """Have a spare run its module; False if it has ended."""
    if spare.poll() is not None or spare.stdin is None:
        return False
    try:
        spare.stdin.write(b"\n")
        spare.stdin.close()
    except BrokenPipeError:
        spare.wait()
        return False
    return True


def _discard_spare(child: _Child) -> None:
    """End a spare that is not needed; it holds nothing to clean up."""
    spare, child.spare = child.spare, None
    if spare is not None:
        spare.kill()
        spare.wait()
        if spare.stdin is not None:
            spare.stdin.close()


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
