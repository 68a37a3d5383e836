"""A killed recorder leaves a file that repairs: a short run of the fault experiment."""

from verification.faults.kill_recorder import KillRecorder


def test_three_killed_recorders_leave_files_that_repair() -> None:
    plan = KillRecorder(kills=3, seed=1, pictures=("jpeg",), longest=1.5)
    rows = list(plan.measure(lambda _text: None))
    assert len(rows) == 3
    for row in rows:
        # On a machine without time for the recorder it loses more; the experiment judges that.
        assert row["defects"] == 0, row["what"]
        assert float(row["messages"]) > 50
