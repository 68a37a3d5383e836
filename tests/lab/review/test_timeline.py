"""Timelines of known runs, and the moments chosen from them."""

import numpy as np
import pytest

from common.schemas import CameraFrame, Gait, OperatorStatus
from common.topics import CAMERA_LEFT, PLANT_TRUTH, TELEOP_STATUS
from lab.review import image_series
from lab.review import timeline as timeline_module
from lab.review.key_moments import FELL, Moment, at_most, key_moments
from lab.review.timeline import RATE, Timeline, frame_step, read_timeline
from tests.lab.review.synthetic import MS, FakeRobot, Pair


def mark(robot: FakeRobot, label: str) -> Pair:
    return TELEOP_STATUS, OperatorStatus(
        header=robot.header(TELEOP_STATUS, "teleop"),
        script="s",
        step=0,
        steps=1,
        label=label,
        finished=False,
    )


def stand(robot: FakeRobot, steps: int, grip: tuple[int, int] = (0, 0)) -> list[Pair]:
    """``steps`` ground truths 100 ms apart, grippers closed between the numbers of ``grip``."""
    pairs = []
    for step in range(steps):
        robot.now += 100
        topic, state = robot.plant(PLANT_TRUTH, 0, 0, 0)
        closure = np.ones(2) if grip[0] <= step < grip[1] else np.zeros(2)
        pairs.append((topic, state.model_copy(update={"gripper_closure": closure})))
    return pairs


def picture(robot: FakeRobot, value: int = 0) -> Pair:
    header = robot.header(CAMERA_LEFT, "cameras")
    data = bytes([value % 256]) * 12
    return CAMERA_LEFT, CameraFrame(
        header=header, eye="left", width=2, height=2, encoding="rgb8", data=data
    )


def test_truth_is_thinned_and_a_reset_kept() -> None:
    robot = FakeRobot()
    pairs = []
    for _ in range(500):
        robot.now += 20
        pairs.append(robot.plant(PLANT_TRUTH, 0, 0, 0))
    timeline = read_timeline(pairs)
    assert len(timeline.truth) == 125
    assert RATE == 12.5
    steps = np.diff([state.header.stamp for state in timeline.truth])
    assert set(steps) == {80 * MS}
    robot.now = 1000
    assert len(read_timeline([*pairs, robot.plant(PLANT_TRUTH, 0, 0, 0)]).truth) == 126


def test_each_gait_type_once_mid_swing_and_each_other_section_at_its_end() -> None:
    robot = FakeRobot()
    walk = [
        *robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)),
        *robot.gait(1, Gait.FORWARD, (0.2, 0, 0), (0.4, 0, 0)),
        *robot.gait(2, Gait.TURN_LEFT, (0.4, 0, 0), (0.4, 0, 0.3)),
    ]
    pairs = [
        *stand(robot, 3),
        mark(robot, "reach"),
        *stand(robot, 10),
        mark(robot, "grip"),
        *stand(robot, 10, grip=(4, 7)),
        mark(robot, "walk"),
    ]
    pairs += [(topic, m) for topic, m in _later(walk, robot) if topic is not TELEOP_STATUS]
    timeline = read_timeline(pairs)
    chosen = key_moments(timeline)
    assert [moment.label for moment in chosen] == ["reach", "grip", "forward", "turn left"]
    assert timeline.label_at(chosen[0].index) == "reach"
    assert timeline.truth[chosen[1].index].gripper_closure[0] == 1.0
    stride = timeline.gaits[0]
    assert stride.start < chosen[2].index < stride.end
    assert [s.gait for s in timeline.gaits] == [Gait.FORWARD, Gait.FORWARD, Gait.TURN_LEFT]


def _later(pairs: list[Pair], robot: FakeRobot) -> list[Pair]:
    """The same messages, stamped after all others of ``robot``, although they were made first."""
    shift = robot.now * MS
    return [
        (
            topic,
            m.model_copy(
                update={"header": m.header.model_copy(update={"stamp": m.header.stamp + shift})}
            ),
        )
        for topic, m in pairs
    ]


def test_without_labels_the_run_is_shown_evenly() -> None:
    chosen = key_moments(read_timeline(stand(FakeRobot(), 61)), spare=6)
    assert [moment.index for moment in chosen] == [0, 10, 20, 30, 40, 50, 60]


def test_a_fall_is_shown_and_an_empty_run_is_not() -> None:
    robot = FakeRobot()
    pairs = [*stand(robot, 10), robot.status(fallen=True), *stand(robot, 5)]
    timeline = read_timeline(pairs)
    assert timeline.fall == 9
    assert "FELL" in [moment.label for moment in key_moments(timeline)]
    assert key_moments(Timeline()) == []


def test_pictures_are_bounded_and_evenly_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_series, "MAX_IMAGES", 20)
    monkeypatch.setattr(timeline_module, "MAX_TRUTH", 100)
    robot = FakeRobot()
    pairs: list[Pair] = []
    for number in range(250):
        pairs += [*stand(robot, 1), picture(robot, number)]
    timeline = read_timeline(pairs)
    images = timeline.left_images
    assert 10 <= len(images) <= 20
    assert images.at(-1) is None
    for index in range(len(timeline.truth)):
        found = images.at(index)
        assert found is not None
        then = round(10.0 * timeline.seconds_at(index))
        # Of 250 pictures at least ten are kept, at like distances.
        assert 0 <= then - found.data[0] <= 32


def test_a_contact_sheet_stays_small() -> None:
    some = [Moment(index, f"label {index % 5}") for index in range(20)]
    assert at_most(20, some) == some
    assert at_most(19, some) == some[:5]
    different = [Moment(index, str(index)) for index in range(1000)]
    different[501] = Moment(501, FELL)
    chosen = at_most(10, different)
    assert len(chosen) == 10
    assert different[501] in chosen
    assert chosen[0] == different[0]
    assert chosen[-1] == different[-1]


def test_a_long_run_is_shown_faster() -> None:
    timeline = read_timeline(stand(FakeRobot(), 100))
    assert frame_step(timeline, most=1000) == 1
    assert frame_step(timeline, most=100) == 1
    assert frame_step(timeline, most=99) == 2


def test_a_long_run_is_thinned_and_its_events_stay_in_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def made() -> Timeline:
        robot = FakeRobot()
        pairs: list[Pair] = []
        for number in range(6):
            x = 0.2 * number
            pairs += robot.gait(number, Gait.FORWARD, (x, 0, 0), (x + 0.2, 0, 0))
        return read_timeline(pairs)

    whole = made()
    monkeypatch.setattr(timeline_module, "MAX_TRUTH", 50)
    thin = made()
    assert len(whole.truth) > 100
    assert 25 <= len(thin.truth) <= 51
    for long, short in zip(whole.gaits, thin.gaits, strict=True):
        assert thin.seconds_at(short.start) == pytest.approx(whole.seconds_at(long.start), abs=0.81)
        assert thin.seconds_at(short.end) == pytest.approx(whole.seconds_at(long.end), abs=0.81)
    assert thin.truth[0] is not None
