"""A result is there whole or not at all."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lab.demonstrations.export.staging import staged
from lab.errors import DatasetError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def ours(path: Path) -> bool:
    return path.is_file() and path.read_text().startswith("ours")


def test_it_appears_at_the_end(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with staged(out, force=False, ours=ours) as path:
        path.write_text("ours 1")
        assert not out.exists()
    assert out.read_text() == "ours 1"
    assert names(out.parent) == ["out"]


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.write_text("ours 1")
    told = pytest.raises(DatasetError, match="cannot be written")
    with told, staged(out, force=True, ours=ours) as path:
        (path / "no directory").write_text("ours 2")
    assert out.read_text() == "ours 1"
    assert names(tmp_path) == ["out"]


def test_only_an_earlier_result_is_replaced_and_only_by_force(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.write_text("ours 1")
    with pytest.raises(DatasetError, match="--force"), staged(out, force=False, ours=ours):
        pass
    with staged(out, force=True, ours=ours) as path:
        path.write_text("theirs")
    assert out.read_text() == "theirs"
    with pytest.raises(DatasetError, match="not replaced"), staged(out, force=True, ours=ours):
        pass
    assert out.read_text() == "theirs"


def test_two_cannot_make_the_same(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with staged(out, force=False, ours=ours) as path:
        with (
            pytest.raises(DatasetError, match="another process"),
            staged(out, force=False, ours=ours),
        ):
            pass
        path.write_text("ours")
    assert out.read_text() == "ours"


def test_what_a_killed_process_left_is_cleared_away(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = (
        "import os, signal, sys; from pathlib import Path\n"
        "from lab.demonstrations.export.staging import staged\n"
        "with staged(Path(sys.argv[1]), force=False, ours=lambda p: False) as path:\n"
        "    path.mkdir(); (path / 'half').write_text('')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(__file__).resolve().parents[4]
    done = subprocess.run([sys.executable, "-c", code, str(out)], cwd=root, check=False)
    assert done.returncode == -signal.SIGKILL
    assert names(tmp_path) == [".out.part"]
    with staged(out, force=False, ours=ours) as path:
        assert not path.exists()
        path.write_text("ours")
    assert names(tmp_path) == ["out"]


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    with pytest.raises(DatasetError, match="--out"), staged(out, force=False, ours=ours):
        pass


@pytest.mark.parametrize("error", [OSError(28, "No space left"), RuntimeError("write failed\nx")])
def test_a_full_disk_is_told_in_one_line(error: Exception, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(DatasetError) as told, staged(out, force=False, ours=ours):
        raise error
    assert "Is the disk full?" in str(told.value)
    assert "\n" not in str(told.value)
    assert names(tmp_path) == []


def test_where_a_link_leads_it_is_made(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "disk" / "out")
    for number in ("1", "2"):
        with staged(link, force=number == "2", ours=ours) as path:
            path.write_text(f"ours {number}")
        assert link.is_symlink()
        assert (tmp_path / "disk" / "out").read_text() == f"ours {number}"
    assert names(tmp_path) == ["disk", "link"]


def test_the_directory_one_is_in_can_be_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    with staged(Path(), force=True, ours=lambda _path: True) as path:
        path.mkdir()
        (path / "new").write_text("")
    assert names(tmp_path / "out") == ["new"]


def replacing(out: Path) -> None:
    """Replace an earlier result."""
    with staged(out, force=True, ours=ours) as path:
        path.write_text("ours 2")


def test_an_end_between_the_two_moves_keeps_the_earlier_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    out.write_text("ours 1")
    rename = Path.rename

    def stopped(self: Path, to: Path) -> Path:
        if self.name == "out" and to == out:
            raise KeyboardInterrupt
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", stopped)
    with pytest.raises(KeyboardInterrupt):
        replacing(out)
    assert (out.read_text(), names(tmp_path)) == ("ours 1", ["out"])


def test_a_kill_between_the_two_moves_keeps_the_earlier_result(tmp_path: Path) -> None:
    out = tmp_path / "out"
    # What is left then.
    workshop = tmp_path / ".out.part"
    workshop.mkdir()
    (workshop / "out").write_text("ours 2")
    (workshop / "out.old").write_text("ours 1")
    with pytest.raises(DatasetError, match="--force"), staged(out, force=False, ours=ours):
        pass
    assert (out.read_text(), names(tmp_path)) == ("ours 1", ["out"])
    replacing(out)
    assert (out.read_text(), names(tmp_path)) == ("ours 2", ["out"])


def test_the_root_of_the_disk_is_not_replaced() -> None:
    with (
        pytest.raises(DatasetError, match="not replaced"),
        staged(Path("/"), force=True, ours=ours),
    ):
        pass
