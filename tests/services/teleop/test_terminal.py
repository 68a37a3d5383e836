"""The keyboard operator as a process in a pseudo-terminal: every way out restores it."""

import fcntl
import os
import pty
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from services.teleop.keyboard.terminal import ENTER, LEAVE

PATIENCE = 30.0
ROOT = Path(__file__).parents[3]

LEADER = """
import signal, subprocess, sys
signal.signal(signal.SIGINT, lambda *_: None)
child = subprocess.Popen(sys.argv[1:])
print("pid", child.pid, flush=True)
print("code", child.wait(), flush=True)
signal.pause()
"""
"""Leads the terminal's session, as a shell or `make` would: the terminal outlives the child."""


def free_port() -> int:
    """Base of a port table that nobody uses, so that no other system on this machine is met."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 60000)


class Pseudoterminal:
    """A Python command under a session leader on a terminal of 80 by 24."""

    def __init__(self, *command: str) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.before = self.attributes()
        self.output = b""
        self.leader = subprocess.Popen(
            [sys.executable, "-c", LEADER, sys.executable, *command],
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            cwd=ROOT,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509
        )
        self.pid = int(self.wait_for(b"pid ", line=True))

    def attributes(self) -> list[Any]:
        return termios.tcgetattr(self.slave)

    def type(self, data: bytes) -> None:
        os.write(self.master, data)

    def wait_for(self, text: bytes, line: bool = False) -> bytes:
        """Read until ``text`` (and the rest of its line) has come; returns what follows it."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            _, found, tail = self.output.partition(text)
            if found and (not line or b"\n" in tail):
                return tail.split(b"\n")[0] if line else tail
            if select.select([self.master], [], [], 0.2)[0]:
                self.output += os.read(self.master, 65536)
        raise AssertionError(f"{text!r} did not come; the terminal shows {self.output!r}")

    def close(self) -> None:
        self.leader.kill()
        self.leader.wait()
        for number in (self.master, self.slave):
            os.close(number)


@pytest.fixture
def terminal() -> Iterator[Pseudoterminal]:
    options = ["--base-port", str(free_port()), "--rt-priority", "0"]
    pseudo = Pseudoterminal("-m", "services.teleop", "keyboard", *options)
    try:
        pseudo.type(b"3")
        pseudo.wait_for(b"select both\x1b")
        assert not restored(pseudo, 0.5)
        assert LEAVE not in pseudo.output
        yield pseudo
    finally:
        pseudo.close()


def restored(terminal: Pseudoterminal, patience: float = PATIENCE) -> bool:
    """Whether the terminal is as before, within a moment (the watchdog is another process)."""
    deadline = time.monotonic() + patience
    while terminal.attributes() != terminal.before and time.monotonic() < deadline:
        time.sleep(0.01)
    return terminal.attributes() == terminal.before


def test_it_takes_the_terminal_over(terminal: Pseudoterminal) -> None:
    assert ENTER in terminal.output
    flags = terminal.attributes()[3]
    assert not flags & termios.ECHO
    assert not flags & termios.ICANON
    assert flags & termios.ISIG
    terminal.type(b"\x1a\x1c1")
    terminal.wait_for(b"select left hand\x1b")


@pytest.mark.parametrize("keys", [b"\x1b", b"\x03"], ids=["Esc", "Ctrl-C"])
def test_keys_that_quit_restore_the_terminal(terminal: Pseudoterminal, keys: bytes) -> None:
    terminal.type(keys)
    assert int(terminal.wait_for(b"code ", line=True)) == 0
    assert restored(terminal)
    assert terminal.output.count(LEAVE) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_signals_restore_the_terminal(terminal: Pseudoterminal, number: signal.Signals) -> None:
    os.kill(terminal.pid, number)
    code = int(terminal.wait_for(b"code ", line=True))
    assert code == (-number if number == signal.SIGKILL else 0)
    terminal.wait_for(LEAVE)
    assert restored(terminal)


HELD = """
import os
from services.teleop.keyboard.terminal import Terminal
terminal = Terminal()
terminal.draw(["first picture", "same line"])
os.write(2, b"trouble")
terminal.draw(["second picture", "same line"])
terminal.close()
terminal.close()
os.write(2, b"afterwards")
"""


def test_errors_are_held_back_until_the_screen_is_left() -> None:
    pseudo = Pseudoterminal("-c", HELD)
    try:
        assert int(pseudo.wait_for(b"code ", line=True)) == 0
    finally:
        pseudo.close()
    screen, _, after = pseudo.output.partition(ENTER)[2].partition(LEAVE)
    assert b"first picture" in screen
    assert b"second picture" in screen
    assert screen.count(b"same line") == 1
    assert after.startswith(b"troubleafterwards")


def test_a_pipe_is_refused() -> None:
    # Under pytest standard input is no terminal, or is made one by -s; a child's is a pipe.
    result = subprocess.run(
        [sys.executable, "-m", "services.teleop", "keyboard"],
        input=b"",
        capture_output=True,
        cwd=ROOT,
        check=False,
    )
    assert result.returncode == 1
    assert b"needs a terminal as its input" in result.stderr
