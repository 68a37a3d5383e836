"""Which moments of a run get a picture."""

import numpy as np

from common.schemas import CameraFrame, Gait, OperatorStatus
from common.topics import CAMERA_LEFT, PLANT_TRUTH, TELEOP_STATUS
from lab.review.film import MOST_PICTURES, RATE, Film, frame_step, gather, moments, picture_at
from tests.lab.review.synthetic import MS, Life, Pair


def mark(life: Life, label: str) -> Pair:
    return TELEOP_STATUS, OperatorStatus(
        header=life.header(TELEOP_STATUS, "teleop"),
        script="s",
        step=0,
        steps=1,
        label=label,
        finished=False,
    )


def stand(life: Life, steps: int, grip: tuple[int, int] = (0, 0)) -> list[Pair]:
    """``steps`` ground truths 100 ms apart, grippers closed between the numbers of ``grip``."""
    pairs = []
    for step in range(steps):
        life.now += 100
        topic, state = life.plant(PLANT_TRUTH, 0, 0, 0)
        closure = np.ones(2) if grip[0] <= step < grip[1] else np.zeros(2)
        pairs.append((topic, state.model_copy(update={"gripper_closure": closure})))
    return pairs


def picture(life: Life, value: int = 0) -> Pair:
    header = life.header(CAMERA_LEFT, "cameras")
    data = bytes([value % 256]) * 12
    return CAMERA_LEFT, CameraFrame(
        header=header, eye="left", width=2, height=2, encoding="rgb8", data=data
    )


def test_truth_is_thinned_and_a_reset_kept() -> None:
    life = Life()
    pairs = []
    for _ in range(500):
        life.now += 20
        pairs.append(life.plant(PLANT_TRUTH, 0, 0, 0))
    film = gather(pairs)
    assert len(film.truth) == 125
    assert RATE == 12.5
    steps = np.diff([state.header.stamp for state in film.truth])
    assert set(steps) == {80 * MS}
    life.now = 1000
    assert len(gather([*pairs, life.plant(PLANT_TRUTH, 0, 0, 0)]).truth) == 126


def test_each_gait_type_once_mid_swing_and_each_other_section_at_its_end() -> None:
    life = Life()
    walk = [
        *life.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)),
        *life.gait(1, Gait.FORWARD, (0.2, 0, 0), (0.4, 0, 0)),
        *life.gait(2, Gait.TURN_LEFT, (0.4, 0, 0), (0.4, 0, 0.3)),
    ]
    pairs = [
        *stand(life, 3),
        mark(life, "reach"),
        *stand(life, 10),
        mark(life, "grip"),
        *stand(life, 10, grip=(4, 7)),
        mark(life, "walk"),
    ]
    pairs += [(topic, m) for topic, m in _later(walk, life) if topic is not TELEOP_STATUS]
    film = gather(pairs)
    chosen = moments(film)
    assert [moment.label for moment in chosen] == ["reach", "grip", "forward", "turn left"]
    assert film.label_at(chosen[0].index) == "reach"
    assert film.truth[chosen[1].index].gripper_closure[0] == 1.0
    stride = film.strides[0]
    assert stride.start < chosen[2].index < stride.end
    assert [s.gait for s in film.strides] == [Gait.FORWARD, Gait.FORWARD, Gait.TURN_LEFT]


def _later(pairs: list[Pair], life: Life) -> list[Pair]:
    """The same messages, stamped after everything ``life`` made so far (they were made first)."""
    shift = life.now * MS
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
    chosen = moments(gather(stand(Life(), 61)), spare=6)
    assert [moment.index for moment in chosen] == [0, 10, 20, 30, 40, 50, 60]


def test_a_fall_is_shown_and_an_empty_run_is_not() -> None:
    life = Life()
    pairs = [*stand(life, 10), life.status(fallen=True), *stand(life, 5)]
    film = gather(pairs)
    assert film.fell == 9
    assert "FELL" in [moment.label for moment in moments(film)]
    assert moments(Film()) == []


def test_pictures_are_bounded_and_found_by_time() -> None:
    life = Life()
    pairs: list[Pair] = []
    for number in range(MOST_PICTURES + 500):
        pairs += [*stand(life, 1), picture(life, number)]
    film = gather(pairs)
    assert MOST_PICTURES / 2 <= len(film.left) <= MOST_PICTURES
    found = picture_at(film.left, 1000)
    assert found is not None
    assert abs(found.data[0] - 1000 % 256) <= 1
    assert picture_at(film.left, -1) is None


def test_a_long_run_is_shown_faster() -> None:
    film = gather(stand(Life(), 100))
    assert frame_step(film, most=1000) == 1
    assert frame_step(film, most=100) == 1
    assert frame_step(film, most=99) == 2
