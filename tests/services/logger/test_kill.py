"""A small version of the study that kills the recorder."""

from pathlib import Path

from verification.faults.kill_recorder import run_trials


def test_three_killed_recorders_leave_files_that_repair(tmp_path: Path) -> None:
    trials = list(run_trials("jpeg", 3, seed=1, work=tmp_path, longest=1.5))
    assert len(trials) == 3
    for trial in trials:
        # A machine that has no time for the recorder lets it lose more; the study measures that.
        faults = [fault for fault in trial.faults if "lost" not in fault and "within" not in fault]
        assert faults == []
        assert trial.messages > 50
