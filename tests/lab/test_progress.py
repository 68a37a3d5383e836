"""Progress of long work, on a terminal and in a file."""

import io

import pytest
from rich.console import Console

from lab.progress import ProgressBar, format_duration


def console(*, terminal: bool) -> tuple[Console, io.StringIO]:
    out = io.StringIO()
    return Console(file=out, width=100, force_terminal=terminal), out


def test_in_a_file_every_result_is_a_line_and_nothing_else_is() -> None:
    where, out = console(terminal=False)
    with ProgressBar("trials", total=2, console=where) as bar:
        bar.say("one was there")
        bar.show(1, text="ETA 0:34")
        bar.advance("seed 5: [success]")
        bar.advance()
    assert out.getvalue() == "one was there\n[2/2] seed 5: [success]\n"


@pytest.mark.parametrize(("total", "count"), [(20, "3/20"), (None, "3"), (40_000, "50 %")], ids=str)
def test_on_a_terminal_a_bar_shows_name_count_and_text(total: float | None, count: str) -> None:
    where, out = console(terminal=True)
    with ProgressBar("trials", console=where) as bar:
        bar.show(20_000 if total == 40_000 else 3, total, "ETA 0:34")
    assert f" {count} ETA 0:34" in out.getvalue()
    assert "trials" in out.getvalue()


def test_durations() -> None:
    assert format_duration(187.4) == "3:07"
    assert format_duration(3723.0) == "1:02:03"
