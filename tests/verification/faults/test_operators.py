"""Two operators of a walking robot, as processes: the short version of the experiment."""

from verification.faults.operators import FAULTS, Operators


def test_a_person_takes_a_walking_robot_and_keeps_it_when_the_controller_is_killed() -> None:
    rows = Operators(rounds=1, faults=3).measure(lambda _text: None)
    by_fault = {str(row["fault"]): row for row in rows}
    assert list(by_fault) == [fault.text for fault in FAULTS[:3]]
    for row in by_fault.values():
        assert (row["wrong"], row["falls"]) == (0, 0), row
        assert float(row["fastest target [m/s]"]) < 1.0, row
    # The lease of a killed operator runs out; a policy that waits does not get the robot.
    assert float(by_fault["person killed"]["max [s]"]) > 0.5
