"""The robomimic export, read back by h5py; robomimic's own loader is in test_loaders."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from common.episodes.episode_file import open_episode
from lab.demonstrations.export import robomimic
from lab.demonstrations.export.fields import ExportColumns
from lab.demonstrations.export.selection import EpisodeSelection, select_episodes
from lab.errors import DatasetError
from tests.lab.demonstrations.export.support import FRAMES, SIZE, VERDICT, make
from verification.loaders.collected import collected_episodes
from verification.loaders.robomimic_check import expected_actions, expected_observations

WIDTHS = {
    **dict.fromkeys(("robot0_left_eef_pos", "robot0_right_foot_pos"), 3),
    **dict.fromkeys(("robot0_left_eef_quat_wxyz", "robot0_right_foot_quat_wxyz"), 4),
    **dict.fromkeys(("robot0_joint_pos_sin", "robot0_joint_pos_cos", "robot0_joint_vel"), 27),
    **dict.fromkeys(("robot0_left_gripper_qpos", "robot0_control_state"), 1),
}


def test_every_number_and_pixel_is_there(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out.hdf5"
    done: list[None] = []
    source = select_episodes(EpisodeSelection((root,)))
    robomimic.write(source, out, scale_actions=False, on_episode=lambda: done.append(None))
    assert len(done) == 3
    with h5py.File(out) as file:
        assert file["data"].attrs["total"] == 3 * VERDICT
        for index, original in enumerate(collected_episodes([root])):
            demo = file[f"data/demo_{index}"]
            assert demo.attrs["num_samples"] == VERDICT
            assert demo.attrs["seed"] == index
            assert demo.attrs["operator"] == "synthetic"
            expected = expected_observations(original)
            images = {"robot0_left_camera_image", "robot0_right_camera_image"}
            assert set(demo["obs"]) == set(expected) | images
            for key, values in expected.items():
                assert demo["obs"][key].dtype == np.float32
                np.testing.assert_array_equal(demo["obs"][key][:], values)
                assert len(demo["obs"][key].attrs["names"]) == values.shape[1]
            for camera in ("left", "right"):
                array = demo[f"obs/robot0_{camera}_camera_image"]
                assert (array.dtype, array.shape) == (np.uint8, (VERDICT, SIZE[1], SIZE[0], 3))
                for frame in range(VERDICT):
                    np.testing.assert_array_equal(array[frame], original.picture(camera, frame))
            np.testing.assert_array_equal(demo["actions"][:], expected_actions(original))
            for key in ("rewards", "dones"):
                assert demo[key][:].tolist() == [0.0] * (VERDICT - 1) + [1.0]


def test_keys_have_the_widths_that_their_names_say(tmp_path: Path) -> None:
    out = tmp_path / "out.hdf5"
    robomimic.write(select_episodes(EpisodeSelection((make(tmp_path / "d", ("success",)),))), out)
    with h5py.File(out) as file:
        for key, width in WIDTHS.items():
            assert file[f"data/demo_0/obs/{key}"].shape == (VERDICT, width), key
        names = list(file["data/demo_0/obs/robot0_right_eef_quat_wxyz"].attrs["names"])
        assert names == ["qw", "qx", "qy", "qz"]
        action = list(file["data"].attrs["action_names"])
        assert action[7] == "right_hand.x"
        assert action[14:] == ["left_gripper", "right_gripper", "locomotion", "neck"]
        environment = json.loads(file["data"].attrs["env_args"])
        assert environment["env_name"] == "door/unlock"
        assert {"type", "env_kwargs"} <= set(environment)
        assert "door" in json.loads(file["data"].attrs["goals"])["door/unlock"]


def test_scaled_actions_can_be_scaled_back(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out.hdf5"
    robomimic.write(select_episodes(EpisodeSelection((root,))), out, compress=True)
    with h5py.File(out) as file:
        about = file["data"].attrs
        every = np.concatenate([file[f"data/{name}/actions"][:] for name in file["data"]])
        np.testing.assert_allclose(every.min(axis=0), -1.0, atol=1e-6)
        np.testing.assert_allclose(every.max(axis=0), 1.0, atol=1e-6)
        assert np.abs(every).max() <= 1.0
        for index, original in enumerate(collected_episodes([root])):
            back = file[f"data/demo_{index}/actions"][:] * about["action_scale"]
            back += about["action_offset"]
            np.testing.assert_allclose(back, expected_actions(original), atol=1e-5)


def test_a_constant_action_is_scaled_to_zero(tmp_path: Path) -> None:
    from tests.lab.demonstrations.export.support import rows

    still = rows(0)
    still.rows["action/neck"] = [0.25] * len(still)
    root, out = make(tmp_path / "d", ("success",), rows_of={0: still}), tmp_path / "out.hdf5"
    robomimic.write(select_episodes(EpisodeSelection((root,))), out)
    with h5py.File(out) as file:
        assert not file["data/demo_0/actions"][:, -1].any()
        assert file["data"].attrs["action_offset"][-1] == 0.25


@pytest.mark.parametrize(("demos", "held"), [(1, 0), (2, 1), (9, 1), (30, 3)])
def test_a_tenth_is_held_back(demos: int, held: int, tmp_path: Path) -> None:
    root = make(tmp_path / "d", ("success",) * demos, size=None)
    for out in (tmp_path / "a.hdf5", tmp_path / "b.hdf5"):
        robomimic.write(select_episodes(EpisodeSelection((root,))), out)
    with h5py.File(tmp_path / "a.hdf5") as file, h5py.File(tmp_path / "b.hdf5") as again:
        train, valid = (set(file[f"mask/{name}"][:]) for name in ("train", "valid"))
        assert len(valid) == held
        assert not train & valid
        assert {name.decode() for name in train | valid} == set(file["data"])
        assert valid == set(again["mask/valid"][:])


def test_no_room_is_told_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = select_episodes(EpisodeSelection((make(tmp_path / "d"),)))
    needed = 3 * VERDICT * 2 * SIZE[0] * SIZE[1] * 3
    usage = type("Usage", (), {"free": needed - 1})()
    monkeypatch.setattr("shutil.disk_usage", lambda _path: usage)
    with pytest.raises(DatasetError, match="--compress"):
        robomimic.write(source, tmp_path / "out.hdf5")
    assert not (tmp_path / "out.hdf5").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d"]
    robomimic.write(source, tmp_path / "out.hdf5", compress=True)


def test_smaller_pictures(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d", ("success",)), tmp_path / "out.hdf5"
    source = select_episodes(EpisodeSelection((root,), width=24))
    robomimic.write(source, out)
    with h5py.File(out) as file, open_episode(root / "episodes/000000.h5") as episode:
        array = file["data/demo_0/obs/robot0_right_camera_image"]
        assert array.shape == (VERDICT, 16, 24, 3)
        whole = episode.picture("right", 4).astype(float)
        means = whole.reshape(16, 2, 24, 2, 3).mean(axis=(1, 3))
        assert np.abs(array[4] - means).max() <= 1.0


def test_a_file_cut_short_is_not_taken_for_ours(tmp_path: Path) -> None:
    out = tmp_path / "d.hdf5"
    robomimic.write(select_episodes(EpisodeSelection((make(tmp_path / "d"),))), out)
    assert robomimic.is_robomimic(out)
    out.write_bytes(out.read_bytes()[:-2000])
    assert not robomimic.is_robomimic(out)


def test_the_observations_after_each_action(tmp_path: Path) -> None:
    root = make(tmp_path / "d", ("success",))
    for tail, last in ((False, VERDICT), (True, FRAMES - 1)):
        source = select_episodes(EpisodeSelection((root,), tail=tail))
        out = tmp_path / f"{last}.hdf5"
        robomimic.write(source, out, next_obs=True)
        with h5py.File(out) as file:
            demo = file["data/demo_0"]
            assert set(demo["next_obs"]) == set(demo["obs"])
            for key in demo["obs"]:
                now, after = demo["obs"][key][:], demo["next_obs"][key][:]
                np.testing.assert_array_equal(after[:-1], now[1:])
            # Before the verdict there is a frame more; after the last frame there is none.
            with open_episode(root / "episodes/000000.h5") as episode:
                speeds = episode.array("observation/joint_velocity").astype(np.float32)
            np.testing.assert_array_equal(demo["next_obs/robot0_joint_vel"][-1], speeds[last])


def test_a_configuration_with_which_robomimic_can_train(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d", ("success",) * 3), tmp_path / "out.hdf5"
    columns = ExportColumns(parts=("hands", "grippers"))
    robomimic.write(select_episodes(EpisodeSelection((root,), columns=columns)), out)
    config = json.loads((tmp_path / "out.config.json").read_text())
    obs = config["observation"]["modalities"]["obs"]
    with h5py.File(out) as file:
        assert set(obs["low_dim"]) | set(obs["rgb"]) == set(file["data/demo_0/obs"])
        assert {config["train"][f"hdf5_{k}filter_key"] for k in ("", "validation_")} == set(
            file["mask"]
        )
        assert file["data/demo_0/obs/robot0_left_camera_image"].attrs["width"] == SIZE[0]
        assert np.abs(file["data/demo_0/actions"][:]).max() <= 1.0
    assert config["train"]["data"] == str(out)
    assert config["experiment"]["rollout"]["enabled"] is False
    assert config["train"]["hdf5_normalize_obs"] is False
    # Both masks must fill at least one batch.
    assert config["train"]["batch_size"] <= VERDICT
    robomimic.write(select_episodes(EpisodeSelection((root,))), out, force=True)
    assert "robot0_joint_vel" in (tmp_path / "out.config.json").read_text()
    assert str(tmp_path / "out.config.json") in robomimic.how_to_use(out)


def test_a_configuration_of_something_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "out.config.json").write_text('{"train": {"data": "mine"}}')
    source = select_episodes(EpisodeSelection((make(tmp_path / "d", ("success",)),)))
    with pytest.raises(DatasetError, match="not replaced"):
        robomimic.write(source, tmp_path / "out.hdf5")
    assert not (tmp_path / "out.hdf5").exists()


def test_actions_beyond_what_policies_can_do_are_told(tmp_path: Path) -> None:
    source = select_episodes(EpisodeSelection((make(tmp_path / "d", ("success",)),)))
    (scaled,) = robomimic.write(source, tmp_path / "a.hdf5")
    assert "action_scale" in scaled
    (raw,) = robomimic.write(source, tmp_path / "b.hdf5", scale_actions=False)
    assert "--no-scale-actions" in raw
