"""An exported file holds the same as the log, read by independent decoders."""

from collections import Counter
from math import isnan
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from common.robot.frames import HAND_FRAMES
from common.robot.joints import JOINT_NAMES
from common.schemas import CameraFrame
from services.logger.errors import ExportError, LoggerError
from services.logger.export.convert import export_log
from tests.services.logger.export_support import (
    EPOCH,
    MS,
    Read,
    command,
    health,
    origin_of,
    plant,
    read,
    sample,
    session,
    setpoint,
    write,
)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Read]]:
    folder = tmp_path_factory.mktemp("export")
    write(folder / "log.mcap", session())
    export_log(folder / "log.mcap", folder / "out.mcap")
    return read(folder / "out.mcap")


def offset_of(log: Path) -> int:
    origin = origin_of(log)
    return int(origin["wall_ns"]) - int(origin["monotonic_ns"])


def position(pose: Any) -> list[float]:
    return [pose.position.x, pose.position.y, pose.position.z]


def wxyz(rotation: Any) -> list[float]:
    return [rotation.w, rotation.x, rotation.y, rotation.z]


def test_every_message_is_there_once(exported: dict[str, list[Read]]) -> None:
    sources = Counter(one.key.removeprefix("draco3/") for one in session())
    found = {topic: len(messages) for topic, messages in exported.items()}
    for name, count in sources.items():
        assert found[f"/{name}"] == count
    assert found["/joints/measured"] == sources["plant/state"] == 20
    assert found["/joints/commanded"] == sources["wbc/command"]
    assert found["/base/measured"] == sources["plant/state"]
    assert found["/base/truth"] == sources["plant/truth"]
    assert found["/hands/left/setpoint"] == sources["teleop/setpoint"]
    assert found["/hands/right/setpoint"] == sources["teleop/setpoint"]
    # 200 Hz of states at most 50 Hz of transforms.
    assert found["/tf"] == 5
    assert found["/events"] == 2


def test_joints_have_their_names_order_and_values(exported: dict[str, list[Read]]) -> None:
    for i, one in enumerate(exported["/joints/measured"]):
        assert one.schema == "sensor_msgs/msg/JointState"
        assert tuple(one.message.name) == JOINT_NAMES
        assert list(one.message.position) == plant(i).joint_position.tolist()
        assert list(one.message.velocity) == plant(i).joint_velocity.tolist()
        assert list(one.message.effort) == plant(i).joint_torque.tolist()
    for i, one in enumerate(exported["/joints/commanded"]):
        assert tuple(one.message.name) == JOINT_NAMES
        assert list(one.message.position) == command(100 + i).position.tolist()
        assert list(one.message.velocity) == command(100 + i).velocity.tolist()
        assert list(one.message.effort) == command(100 + i).torque.tolist()


def test_a_jpeg_stays_as_it_is(exported: dict[str, list[Read]]) -> None:
    for one in exported["/camera/left"]:
        assert one.schema == "sensor_msgs/msg/CompressedImage"
        assert bytes(one.message.data) == b"\xff\xd8 any bytes"
        assert one.message.format == "jpeg"
        assert one.message.header.frame_id == "left_camera"


def test_plain_rgb_becomes_a_jpeg_of_the_same_colours(tmp_path: Path) -> None:
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[:, :32], rgb[:, 32:] = (200, 30, 60), (20, 90, 220)
    frame = CameraFrame(eye="right", width=64, height=48, encoding="rgb8", data=rgb.tobytes())
    write(tmp_path / "log.mcap", [sample("camera/right", frame, 0)])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    (one,) = read(tmp_path / "out.mcap")["/camera/right"]
    bgr = cv2.imdecode(np.frombuffer(bytes(one.message.data), np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    assert bgr.shape == (48, 64, 3)
    assert np.abs(bgr[20, 10, ::-1].astype(int) - (200, 30, 60)).max() < 12
    assert np.abs(bgr[20, 50, ::-1].astype(int) - (20, 90, 220)).max() < 12


def test_a_frame_that_lies_about_its_size_is_left_out(tmp_path: Path) -> None:
    frame = CameraFrame(eye="right", width=64, height=48, encoding="rgb8", data=b"too short")
    write(tmp_path / "log.mcap", [sample("camera/right", frame, 0), *session()])
    summary = export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    count, reason = summary.left_out["camera/right"]
    assert count == 1
    assert "expected 9216 bytes, got 9" in reason


def test_poses_keep_place_turn_and_frame(exported: dict[str, list[Read]]) -> None:
    for i, one in enumerate(exported["/base/measured"]):
        assert one.message.frame_id == "world"
        assert position(one.message.pose) == plant(i).base_position.tolist()
        assert wxyz(one.message.pose.orientation) == plant(i).base_quaternion.tolist()
    for i, one in enumerate(exported["/base/truth"]):
        assert position(one.message.pose) == plant(300 + 4 * i).base_position.tolist()
    for side in HAND_FRAMES:
        for i, one in enumerate(exported[f"/hands/{side}/setpoint"]):
            wanted = setpoint(200 + 4 * i)
            place = getattr(wanted, f"{side}_hand_position_in_body")
            rotation = getattr(wanted, f"{side}_hand_quaternion_in_body")
            assert one.message.frame_id == "torso_link"
            assert position(one.message.pose) == place.tolist()
            assert wxyz(one.message.pose.orientation) == rotation.tolist()


def test_times_are_on_the_wall_clock(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", session())
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    offset = offset_of(tmp_path / "log.mcap")
    found = read(tmp_path / "out.mcap")
    for i, one in enumerate(found["/joints/measured"]):
        arrival = offset + EPOCH + 5 * i * MS
        assert (one.log_time, one.publish_time) == (arrival, arrival - MS)
        assert one.sequence == i
        stamp = one.message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == arrival - MS
    for one in found["/camera/left"]:
        stamp = one.message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == offset + EPOCH - 7 * MS
    transform = found["/tf"][0].message.transforms[0]
    assert transform.timestamp.ToNanoseconds() == offset + EPOCH - MS
    assert found["/plant/state"][3].message.header.stamp == 15 * MS


def test_a_clock_of_another_machine_is_not_believed(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [sample("plant/truth", plant(0), 0, sent=77_000, captured=76_000)])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    (one,) = read(tmp_path / "out.mcap")["/base/truth"]
    arrival = offset_of(tmp_path / "log.mcap") + EPOCH
    assert one.publish_time == one.log_time == arrival
    # It was captured 1 µs before it was sent, whatever the sender's clock.
    assert one.message.timestamp.ToNanoseconds() == arrival - 1000


def test_health_is_laid_flat_for_plots(exported: dict[str, list[Read]]) -> None:
    (one,) = exported["/links/wbc/teleop/setpoint"]
    link = health("wbc").links[0]
    assert one.message.age == link.age
    assert one.message.injected_requested_mean == 0.122
    assert one.message.injected_achieved_mean == 0.1225
    assert (one.message.wire_median, one.message.wire_p99) == (0.001, 0.002)
    assert one.message.injected_p99 == 0.19
    assert isnan(one.message.total_median)
    assert one.message.link == "normal(122ms, 190ms)"


def test_a_link_that_never_carried_a_message_has_no_age(tmp_path: Path) -> None:
    quiet = health("wbc").links[0].model_copy(update={"age": -1.0, "received": 0})
    message = health("wbc").model_copy(update={"links": [quiet]})
    write(tmp_path / "log.mcap", [sample("health/wbc", message, 0, "wbc")])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    (one,) = read(tmp_path / "out.mcap")["/links/wbc/teleop/setpoint"]
    assert isnan(one.message.age)


def test_events_are_lines_of_text(exported: dict[str, list[Read]]) -> None:
    asked, refused = exported["/events"]
    assert asked.message.message == "gait TURN_LEFT requested (#7)"
    assert refused.message.message == "gait TURN_LEFT REFUSED (#7): busy"
    assert (asked.message.level, refused.message.level) == (2, 3)


def test_only_the_topics_asked_for(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", session())
    summary = export_log(
        tmp_path / "log.mcap", tmp_path / "out.mcap", topics=["camera/*", "wbc/reply"]
    )
    assert set(read(tmp_path / "out.mcap")) == {
        "/camera/left", "/camera/left/camera_info", "/wbc/reply", "/events",
    }  # fmt: skip
    assert summary.left_out["plant/state"] == (20, "not among --topics")
    with pytest.raises(ExportError, match=r"matches 'camera/middle'; it has: camera/left, .*"):
        export_log(tmp_path / "log.mcap", tmp_path / "b.mcap", topics=["camera/middle"])


def test_a_log_cut_off_and_one_in_parts(tmp_path: Path) -> None:
    samples = [sample("plant/state", plant(i), i) for i in range(30)]
    write(tmp_path / "log.mcap", samples[:12], finish=False)
    write(tmp_path / "log-2.mcap", samples[12:])
    summary = export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    found = read(tmp_path / "out.mcap")["/joints/measured"]
    assert [list(one.message.position) for one in found] == [
        plant(i).joint_position.tolist() for i in range(30)
    ]
    first, second = (offset_of(tmp_path / "log.mcap"), found[-1].log_time - EPOCH - 145 * MS)
    assert first == second
    assert any("cut off" in remark for remark in summary.remarks)


def test_what_cannot_be_converted_is_said(tmp_path: Path) -> None:
    from common.transport.tap import RawSample

    stranger = RawSample("draco3/else", b"\x01", "other", EPOCH)
    good = sample("plant/state", plant(0), 0)
    garbage = RawSample("draco3/plant/state", b"\x81", good.tag, EPOCH)
    write(tmp_path / "log.mcap", [stranger, garbage, good])
    summary = export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    assert summary.converted == {"plant/state": 1}
    assert summary.left_out["else"] == (1, "not in the topic table")
    assert "PlantState" in summary.left_out["plant/state"][1]


def test_nothing_is_overwritten_or_left_behind(tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    write(tmp_path / "log.mcap", session())
    out.write_bytes(b"precious")
    with pytest.raises(ExportError, match=r"exists already.*--force"):
        export_log(tmp_path / "log.mcap", out)
    assert out.read_bytes() == b"precious"
    export_log(tmp_path / "log.mcap", out, force=True)
    assert read(out)
    with pytest.raises(ExportError, match="is the log itself"):
        export_log(tmp_path / "log.mcap", tmp_path / "log.mcap", force=True)
    (tmp_path / "text.mcap").write_text("no log")
    with pytest.raises(LoggerError, match="not an MCAP log"):
        export_log(tmp_path / "text.mcap", tmp_path / "none.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.mcap", "out.mcap", "text.mcap"]


def test_an_interrupted_export_leaves_nothing(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", session())

    def interrupt(_done: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_log(tmp_path / "log.mcap", tmp_path / "out.mcap", on_progress=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_progress_ends_at_the_total(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", session())
    calls: list[tuple[int, int]] = []
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap", on_progress=lambda *x: calls.append(x))
    total = len(session())
    assert calls[-1] == (total, total)
