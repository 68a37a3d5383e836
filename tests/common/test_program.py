"""Programs end with words and an exit code, whatever ends them."""

import signal
import subprocess
import sys

import pytest

from common.errors import ConfigError, TrillError
from common.program import ENDING, run_program


def _fail(error: BaseException) -> int:
    raise error


@pytest.mark.parametrize(
    ("error", "code"),
    [(TrillError("no plant"), 1), (ConfigError("no option"), 2), (KeyboardInterrupt(), 130)],
)
def test_expected_ends_have_an_exit_code(
    error: BaseException, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_program("it", lambda: _fail(error)) == code
    told = capsys.readouterr().err
    assert told == (f"it: {error}\n" if str(error) else "")


def test_other_errors_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        run_program("it", lambda: 1 // 0)


@pytest.mark.parametrize("lines", [1, 100_000])
def test_a_reader_that_goes_away_is_no_error(lines: int) -> None:
    """As in ``trill info | head``: the buffer breaks at once or only when it is flushed."""
    program = f"""
from common.program import run_program
import sys
def work():
    sys.stdin.readline()
    for _ in range({lines}): print("x" * 20)
    return 0
sys.exit(run_program("it", work))"""
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        process.stdin.write(b"go\n")
        process.stdin.close()
        assert process.wait(30) == 141
        assert process.stderr.read() == b""


@pytest.mark.parametrize("number", ENDING)
def test_every_signal_that_asks_for_the_end_cleans_up(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    cleaned: list[signal.Signals] = []
    before = [signal.getsignal(one) for one in ENDING]

    def work() -> int:
        try:
            signal.raise_signal(number)
        finally:
            # As from timeout: the process gets it, and then its group.
            signal.raise_signal(number)
            cleaned.append(number)
        return 0

    assert run_program("it", work, "stopped; nothing is lost") == 130
    assert cleaned == [number]
    assert capsys.readouterr().err == "it: stopped; nothing is lost\n"
    assert [signal.getsignal(one) for one in ENDING] == before


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)

    def work() -> int:
        signal.raise_signal(signal.SIGHUP)
        return 0

    try:
        assert run_program("it", work) == 0
    finally:
        signal.signal(signal.SIGHUP, before)
