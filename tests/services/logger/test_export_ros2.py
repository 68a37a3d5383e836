"""An export of ROS 2 messages only, as a reader of bags takes it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from common.schemas import SceneState
from common.schemas.task import ScenePose
from lab.cli.main import main
from services.logger.export.convert import export_log
from tests.services.logger.export_support import plant, sample, session, turn, write


def bag(path: Path) -> dict[str, list[tuple[str, int, Any]]]:
    """Type, log time and message of everything in a bag, by topic."""
    found: dict[str, list[tuple[str, int, Any]]] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, timestamp, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((connection.msgtype, timestamp, message))
    return found


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[str, int, Any]]]:
    folder = tmp_path_factory.mktemp("ros2")
    box = ScenePose(name="box", position=np.array([1.0, 2.0, 3.0]), quaternion=turn(9))
    scene = SceneState(scene="box", objects=[box], marks=[])
    write(folder / "log.mcap", [*session(), sample("task/scene", scene, 30)])
    assert main(["export", str(folder), "--ros2"]) == 0
    return bag(folder / "log-ros2.mcap")


def test_a_bag_reader_finds_every_form(exported: dict[str, list[tuple[str, int, Any]]]) -> None:
    kinds = {topic: found[0][0] for topic, found in exported.items()}
    assert kinds == {
        "/joints/measured": "sensor_msgs/msg/JointState",
        "/joints/commanded": "sensor_msgs/msg/JointState",
        "/base/measured": "geometry_msgs/msg/PoseStamped",
        "/base/truth": "geometry_msgs/msg/PoseStamped",
        "/hands/left/measured": "geometry_msgs/msg/PoseStamped",
        "/hands/right/measured": "geometry_msgs/msg/PoseStamped",
        "/hands/left/setpoint": "geometry_msgs/msg/PoseStamped",
        "/hands/right/setpoint": "geometry_msgs/msg/PoseStamped",
        "/camera/left/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        "/camera/left/camera_info": "sensor_msgs/msg/CameraInfo",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/rosout": "rcl_interfaces/msg/Log",
    }


def test_numbers_and_frames_are_the_logs(exported: dict[str, list[tuple[str, int, Any]]]) -> None:
    _, logged, pose = exported["/base/measured"][0]
    state = plant(0)
    assert pose.header.frame_id == "world"
    where, rotation = pose.pose.position, pose.pose.orientation
    assert [where.x, where.y, where.z] == state.base_position.tolist()
    wxyz = [rotation.w, rotation.x, rotation.y, rotation.z]
    assert wxyz == state.base_quaternion.tolist()
    stamp = pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec
    assert 0 < logged - stamp < 10**9
    transforms = {one.child_frame_id: one for one in exported["/tf"][0][2].transforms}
    assert transforms["torso_link"].header.frame_id == "world"
    assert transforms["left_camera"].header.frame_id == "neck_pitch_link"
    box = exported["/tf"][-1][2].transforms[0]
    assert (box.child_frame_id, box.transform.translation.z) == ("scene/box", 3.0)
    assert exported["/rosout"][1][2].level == 30


def test_a_camera_is_described_by_its_field_of_view_and_baseline(tmp_path: Path) -> None:
    from common.schemas import CameraFrame
    from tests.services.logger.support import sample as arrival

    frames = [
        CameraFrame(eye=eye, width=640, height=360, encoding="jpeg", data=b"x")
        for eye in ("left", "right")
    ]
    arrivals = [arrival(f"camera/{one.eye}", one, 0, 10**12) for one in frames]
    write(tmp_path / "log.mcap", arrivals)
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap", ros2=True)
    found = bag(tmp_path / "out.mcap")
    left, right = (found[f"/camera/{eye}/camera_info"][0][2] for eye in ("left", "right"))
    assert (left.width, left.height, left.header.frame_id) == (640, 360, "left_camera")
    # 120 degrees of vertical field of view, 60 mm apart.
    focal = 180 / np.tan(np.radians(60))
    assert left.k.tolist() == pytest.approx([focal, 0, 320, 0, focal, 180, 0, 0, 1])
    assert (left.p[3], right.p[3]) == pytest.approx((0.0, -0.06 * focal))
