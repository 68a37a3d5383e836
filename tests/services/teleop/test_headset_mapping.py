"""From controllers to set-points: no jumps, no head in the hands, the same on both sides."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.robot.rotations import (
    quaternion_from_rotation_vector,
    quaternion_from_rpy,
    rotation_between,
)
from common.robot.workspace import clamp_to_workspace
from common.schemas import DeviceInput, Gait, HandController
from common.schemas.arrays import Float64Array as Array
from services.teleop.headset.mapping import (
    GAIT_BUTTONS,
    Button,
    HeadsetMapper,
    from_local_floor,
    head_yaw,
)

DT = 0.05
relaxed = settings(deadline=None, max_examples=50)
MIRROR = np.array([1.0, -1.0, 1.0])
QUATERNION_MIRROR = np.array([1.0, -1.0, 1.0, -1.0])

small = st.floats(-0.3, 0.3)
vectors = st.tuples(small, small, small).map(np.array)
turns = st.tuples(*[st.floats(-0.8, 0.8)] * 3).map(np.array)
angles = st.floats(-3.1, 3.1)


def controller(
    position: Array | None = None, turn: Array | None = None, **more: Any
) -> HandController:
    values: dict[str, Any] = {
        "position": np.array([0.3, 0.2, 1.1]) if position is None else position,
        "quaternion": quaternion_from_rotation_vector(np.zeros(3) if turn is None else turn),
        "tracked": True,
        "squeeze": 1.0,
    }
    return HandController(**(values | more))


def sample(
    left: HandController | None = None,
    right: HandController | None = None,
    *,
    head: Array | None = None,
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tracked: bool = True,
) -> DeviceInput:
    away = controller(squeeze=0.0)
    return DeviceInput(
        device="test",
        head_position=np.array([0.0, 0.0, 1.6]) if head is None else head,
        head_quaternion=quaternion_from_rpy(*rpy),
        head_tracked=tracked,
        left=left or away,
        right=right or away,
    )


def poses(mapper: HeadsetMapper) -> Array:
    setpoint = mapper.setpoint()
    return np.concatenate(
        [
            setpoint.left_hand_position_in_body,
            setpoint.left_hand_quaternion_in_body,
            setpoint.right_hand_position_in_body,
            setpoint.right_hand_quaternion_in_body,
            setpoint.gripper_closure,
        ]
    )


def kept(values: Array) -> Array:
    """What the controller makes of :func:`poses`."""
    left, right = clamp_to_workspace("left", values[:3]), clamp_to_workspace("right", values[7:10])
    return np.concatenate([left, values[3:7], right, values[10:]])


def fed(*samples: DeviceInput | None) -> HeadsetMapper:
    mapper = HeadsetMapper()
    for i, item in enumerate(samples):
        mapper.update(item, i * DT)
    return mapper


@relaxed
@given(start=vectors, moved=vectors, yaw=angles)
def test_a_hand_moves_as_its_controller_seen_from_the_head(
    start: Array, moved: Array, yaw: float
) -> None:
    before = fed()
    rpy = (0.0, 0.4, yaw)
    after = fed(sample(controller(start), rpy=rpy), sample(controller(start + moved), rpy=rpy))
    c, s = math.cos(yaw), math.sin(yaw)
    seen = np.array([c * moved[0] + s * moved[1], -s * moved[0] + c * moved[1], moved[2]])
    wanted = before.hands["left"].target.position + seen
    np.testing.assert_allclose(after.hands["left"].target.position, wanted, atol=1e-9)


@relaxed
@given(turn=turns, yaw=angles)
def test_a_hand_turns_as_its_controller_seen_from_the_head(turn: Array, yaw: float) -> None:
    rpy = (0.0, 0.0, yaw)
    after = fed(sample(controller(), rpy=rpy), sample(controller(turn=turn), rpy=rpy))
    turned = rotation_between(
        fed().hands["left"].target.quaternion, after.hands["left"].target.quaternion
    )
    c, s = math.cos(yaw), math.sin(yaw)
    seen = [c * turn[0] + s * turn[1], -s * turn[0] + c * turn[1], turn[2]]
    np.testing.assert_allclose(turned, seen, atol=1e-9)


@relaxed
@given(head=vectors, roll=small, pitch=st.floats(-1.2, 1.2), yaw=angles, yaw0=angles)
def test_nothing_the_head_does_moves_a_hand(
    head: Array, roll: float, pitch: float, yaw: float, yaw0: float
) -> None:
    held = controller(np.array([0.2, 0.1, 1.0]))
    still = sample(held, held, rpy=(0.0, 0.0, yaw0))
    moved = sample(held, held, head=head, rpy=(roll, pitch, yaw))
    np.testing.assert_allclose(poses(fed(still, moved)), poses(fed(still)), atol=1e-12)
    # Nor does it change which way a hand goes that was engaged before.
    further = controller(np.array([0.25, 0.13, 1.02]))
    one = fed(still, moved, sample(further, further, head=head, rpy=(roll, pitch, yaw)))
    other = fed(still, sample(further, further, rpy=(0.0, 0.0, yaw0)))
    np.testing.assert_allclose(poses(one), poses(other), atol=1e-9)


interruptions = st.sampled_from(["squeeze", "tracking", "silence"])


@relaxed
@given(moved=vectors, turn=turns, elsewhere=vectors, away=turns, how=interruptions, yaw=angles)
def test_engaging_anew_never_jumps(
    moved: Array, turn: Array, elsewhere: Array, away: Array, how: str, yaw: float
) -> None:
    mapper = fed(sample(controller()), sample(controller(moved, turn, trigger=0.7)))
    before = kept(poses(mapper))
    now = 2 * DT
    if how == "squeeze":
        mapper.update(sample(controller(moved, turn, squeeze=0.2)), now)
    elif how == "tracking":
        mapper.update(sample(controller(elsewhere, away, tracked=False)), now)
    else:
        now += 1.0
        mapper.update(None, now)
    assert not mapper.hands["left"].engaged
    np.testing.assert_allclose(poses(mapper), before, atol=1e-12)
    mapper.update(sample(controller(elsewhere, away), rpy=(0.0, 0.0, yaw)), now + DT)
    assert mapper.hands["left"].engaged
    np.testing.assert_allclose(poses(mapper), before, atol=1e-12)


@relaxed
@given(start=vectors, moved=vectors, turn=turns, yaw=angles, trigger=st.floats(0.0, 1.0))
def test_mirrored_inputs_mirror_the_outputs(
    start: Array, moved: Array, turn: Array, yaw: float, trigger: float
) -> None:
    first, second = controller(start), controller(start + moved, turn, trigger=trigger)
    one = fed(*[sample(left=c, rpy=(0.0, 0.0, yaw)) for c in (first, second)])
    mirrored = [
        c.model_copy(
            update={
                "position": c.position * MIRROR,
                "quaternion": c.quaternion * QUATERNION_MIRROR,
            }
        )
        for c in (first, second)
    ]
    other = fed(*[sample(right=c, rpy=(0.0, 0.0, -yaw)) for c in mirrored])
    left, right = one.setpoint(), other.setpoint()
    np.testing.assert_allclose(
        left.left_hand_position_in_body,
        right.right_hand_position_in_body * MIRROR,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        left.left_hand_quaternion_in_body,
        right.right_hand_quaternion_in_body * QUATERNION_MIRROR,
        atol=1e-9,
    )
    np.testing.assert_allclose(left.gripper_closure, right.gripper_closure[::-1])


def test_a_hand_sent_out_of_the_workspace_obeys_at_once_when_engaged_anew() -> None:
    far, back = np.array([9.0, 0.0, 0.0]), np.array([8.95, 0.0, 0.0])
    mapper = fed(sample(controller(np.zeros(3))), sample(controller(far)))
    rest = fed().hands["left"].target.position
    np.testing.assert_allclose(mapper.hands["left"].target.position, rest + far)
    mapper.update(sample(controller(far, squeeze=0.0)), 2 * DT)
    assert mapper.hands["left"].target.position[0] == pytest.approx(0.56)
    mapper.update(sample(controller(far)), 3 * DT)
    mapper.update(sample(controller(back)), 4 * DT)
    assert mapper.hands["left"].target.position[0] == pytest.approx(0.51)


def test_a_gripper_waits_for_its_trigger_after_engaging() -> None:
    mapper = fed(sample(controller()), sample(controller(trigger=1.0)))
    assert mapper.hands["left"].closure == 1.0
    mapper.update(sample(controller(squeeze=0.0)), 0.1)
    for i, (trigger, closure) in enumerate([(0.0, 1.0), (0.5, 1.0), (0.95, 0.95), (0.3, 0.3)]):
        mapper.update(sample(controller(trigger=trigger)), 0.15 + i * DT)
        assert mapper.hands["left"].closure == closure


@pytest.mark.parametrize("button", list(Button))
def test_each_gait_has_a_button_and_each_press_is_one_request(button: Button) -> None:
    hand, name = button.value
    rest = controller(squeeze=0.0)
    pressed = rest.model_copy(update={name: True})
    down = sample(pressed, rest) if hand == "left" else sample(rest, pressed)
    mapper = HeadsetMapper(first_id=40)
    assert mapper.update(sample(rest, rest), 0.0) == []
    asked = [r for i in range(1, 5) for r in mapper.update(down, i * DT)]
    assert [(r.request_id, r.gait) for r in asked] == [(40, GAIT_BUTTONS[button])]
    mapper.update(sample(rest, rest), 0.3)
    assert [r.request_id for r in mapper.update(down, 0.35)] == [41]
    assert sorted(GAIT_BUTTONS.values()) == [gait for gait in Gait if gait is not Gait.NONE]


def test_a_button_pressed_during_a_silence_asks_for_nothing() -> None:
    rest, down = sample(), sample(controller(squeeze=0.0, upper=True))
    mapper = fed(rest)
    mapper.update(None, 1.0)
    assert mapper.update(down, 1.05) == []
    mapper.update(rest, 1.1)
    assert [request.gait for request in mapper.update(down, 1.15)] == [Gait.FORWARD]


def test_an_untracked_head_engages_nothing_and_leaves_the_neck() -> None:
    mapper = fed(sample(rpy=(0.0, 0.3, 0.0)))
    mapper.update(sample(controller(), rpy=(0.0, 0.9, 0.0), tracked=False), DT)
    assert not mapper.hands["left"].engaged
    assert mapper.neck == pytest.approx(0.3)


@relaxed
@given(yaw=angles, pitch=st.floats(-1.5, 1.5))
def test_heading_of_a_nodding_head(yaw: float, pitch: float) -> None:
    assert math.remainder(
        head_yaw(quaternion_from_rpy(0.0, pitch, yaw)) - yaw, math.tau
    ) == pytest.approx(0.0, abs=1e-6)


def test_axes_of_webxr() -> None:
    # Looking to the right (a turn of -90° about WebXR's up), 1.6 m up, one step ahead and aside.
    half = -math.pi / 4
    position, quaternion = from_local_floor(
        np.array([0.2, 1.6, -1.0]), np.array([math.cos(half), 0.0, math.sin(half), 0.0])
    )
    np.testing.assert_allclose(position, [1.0, -0.2, 1.6])
    assert head_yaw(quaternion) == pytest.approx(-math.pi / 2)
