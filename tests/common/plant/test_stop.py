"""The record of stops, and its file."""

from pathlib import Path

import pytest

from common.plant.stop import StopRecord, load_stop, save_stop

PRESSED = StopRecord(latched=True, stops=1, by="keyboard", reason="smoke")


def test_a_stop_is_numbered_and_cleared_by_its_number() -> None:
    assert StopRecord().pressed("keyboard", "smoke") == PRESSED
    assert PRESSED.pressed("headset", "fire") is PRESSED
    for wrong in (0, 2):
        assert PRESSED.cleared(wrong) is PRESSED
    free = PRESSED.cleared(1)
    assert free == StopRecord(stops=1)
    assert free.cleared(1) is free
    assert free.pressed("headset", "fire").stops == 2


def test_long_words_are_cut_to_what_the_status_holds() -> None:
    stop = StopRecord().pressed("s" * 100, "r" * 300)
    assert (len(stop.by), len(stop.reason)) == (64, 200)


def test_the_file_says_the_same_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "var" / "lib" / "estop.json"
    assert load_stop(path) == StopRecord()
    for record in (PRESSED, PRESSED.cleared(1)):
        save_stop(path, record)
        assert load_stop(path) == record
    assert [p.name for p in path.parent.iterdir()] == ["estop.json"]


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b'{"latched": "perhaps"}', b'{"stopped": 1}'])
def test_a_damaged_file_is_a_stop(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "estop.json"
    path.write_bytes(text)
    stop = load_stop(path)
    assert (stop.latched, stop.stops, stop.by) == (True, 1, "plant")
    assert "is damaged (" in stop.reason
    assert "estop.json" in stop.reason


def test_an_unreadable_file_is_a_stop(tmp_path: Path) -> None:
    stop = load_stop(tmp_path)
    assert stop.latched
    assert "cannot be read" in stop.reason
