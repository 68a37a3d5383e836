"""The lerobot export, read back by pyarrow and av; lerobot's own loader is in test_loaders."""

import json
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from lab.demonstrations.export import lerobot, lerobot_layout
from lab.demonstrations.export.fields import ExportColumns
from lab.demonstrations.export.selection import EpisodeSelection, select_episodes
from lab.demonstrations.export.stats import column_stats, rare_columns
from lab.errors import DatasetError
from services.sim.tasks import find_task
from tests.lab.demonstrations.export.support import FRAMES, SIZE, VERDICT, make, rows
from verification.loaders.collected import CollectedEpisode, collected_episodes, psnr
from verification.loaders.lerobot_check import middle_frame

STATE = ("poses", "gripper_closure", "joint_sin_cos", "joint_velocity", "control_state")
ACTION = ("hands", "grasp", "locomotion", "neck")
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def load(path: Path) -> Any:
    return json.loads(path.read_text())


def table(out: Path) -> Any:
    files = sorted((out / "data").rglob("*.parquet"))
    return [row for path in files for row in pq.read_table(path).to_pylist()]


def episodes(out: Path) -> Any:
    return pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def joined(original: CollectedEpisode, group: str, names: tuple[str, ...]) -> Any:
    return np.concatenate([original.array(f"{group}/{name}") for name in names], axis=1)


def test_every_number_is_there(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out"
    done: list[None] = []
    lerobot.write(
        select_episodes(EpisodeSelection((root,))), out, on_episode=lambda: done.append(None)
    )
    assert len(done) == 3
    rows = table(out)
    assert [row["index"] for row in rows] == list(range(3 * VERDICT))
    for index, original in enumerate(collected_episodes([root])):
        state = joined(original, "observation", STATE)
        action = joined(original, "action", ACTION)
        assert (state.shape[1], action.shape[1]) == (112, 18)
        for frame, row in enumerate(rows[index * VERDICT : (index + 1) * VERDICT]):
            assert row["observation.state"] == state[frame].tolist()
            assert row["action"] == action[frame].tolist()
            assert row["age.seen"] == original.array("age/seen")[frame, 0]
            assert (row["episode_index"], row["frame_index"]) == (index, frame)
            assert row["timestamp"] == np.float32(frame / 20)
            last = frame == VERDICT - 1
            assert (row["next.done"], row["next.success"], row["next.reward"]) == (last, last, last)
            assert row["task_index"] == 0


def test_the_description_fits_the_tables(tmp_path: Path) -> None:
    out = tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((make(tmp_path / "d"),))), out)
    info = load(out / "meta/info.json")
    assert info["codebase_version"] == "v3.0"
    assert (info["fps"], info["robot_type"]) == (20, "draco3")
    assert (info["total_episodes"], info["total_frames"]) == (3, 3 * VERDICT)
    assert info["splits"] == {"train": "0:3"}
    schema = pq.read_schema(out / "data/chunk-000/file-000.parquet")
    tabled = {key for key, about in info["features"].items() if about["dtype"] != "video"}
    assert set(schema.names) == tabled
    for key in ("observation.state", "action"):
        about = info["features"][key]
        assert about["shape"] == [len(about["names"])] == [schema.field(key).type.list_size]
        assert len(set(about["names"])) == len(about["names"])
    assert info["features"]["action"]["names"][-2:] == ["locomotion", "neck"]
    assert info["features"]["observation.images.left"]["shape"] == [32, 48, 3]
    goal = find_task("door/unlock").goal
    tasks = pq.read_table(out / "meta/tasks.parquet")
    assert tasks.to_pylist() == [{"task_index": 0, "task": goal}]
    pandas = json.loads(tasks.schema.metadata[b"pandas"])
    assert pandas["index_columns"] == ["task"]
    for index, row in enumerate(episodes(out)):
        assert row["tasks"] == [goal]
        assert (row["seed"], row["success"], row["operator"]) == (index, True, "synthetic")
        assert (row["dataset_from_index"], row["dataset_to_index"]) == (
            index * VERDICT,
            (index + 1) * VERDICT,
        )
    about = load(out / "meta/trill.json")
    assert about["operators"] == {"synthetic": 3}
    assert [one["seed"] for one in about["episodes"]] == [0, 1, 2]
    assert "synthetic operator" in (out / "README.md").read_text()


def decoded(path: Path) -> list[tuple[float, Any]]:
    with av.open(str(path)) as file:
        return [(frame.time, frame.to_ndarray(format="rgb24")) for frame in file.decode(video=0)]


@pytest.mark.parametrize("limit", [200 << 20, 0])
def test_videos_show_what_was_seen(
    limit: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot_layout, "VIDEO_MB", limit >> 20)
    monkeypatch.setattr(lerobot_layout, "DATA_MB", limit >> 20)
    root, out = make(tmp_path / "d"), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,))), out)
    rows = episodes(out)
    # A file that is large enough gets no further episode.
    assert [row["data/file_index"] for row in rows] == ([0, 0, 0] if limit else [0, 1, 2])
    assert len(table(out)) == 3 * VERDICT
    for original, row in zip(collected_episodes([root]), rows, strict=True):
        for camera in ("left", "right"):
            key = f"videos/observation.images.{camera}"
            file = row[f"{key}/file_index"]
            frames = decoded(out / key / f"chunk-000/file-{file:03d}.mp4")
            begin = row[f"{key}/from_timestamp"]
            assert row[f"{key}/to_timestamp"] == pytest.approx(begin + VERDICT / 20)
            found = {round((time - begin) * 20, 6): shown for time, shown in frames}
            for frame in range(VERDICT):
                assert psnr(found[frame], original.picture(camera, frame)) > 30.0


def test_embedded_pictures_are_the_collected_files(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,))), out, video=False)
    assert load(out / "meta/info.json")["features"]["observation.images.right"]["dtype"] == "image"
    assert not (out / "videos").exists()
    rows = table(out)
    for index, original in enumerate(collected_episodes([root])):
        group = original.file["images/right"]
        for frame in range(VERDICT):
            begin, end = group["offset"][frame : frame + 2]
            kept = rows[index * VERDICT + frame]["observation.images.right"]
            assert kept["bytes"] == group["data"][begin:end].tobytes()


def test_embedded_pictures_of_another_size_lose_nothing_more(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d", ("success",)), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,), width=25, height=17)), out, video=False)
    (expected,) = (original.picture("left", 3, (25, 17)) for original in collected_episodes([root]))
    file = table(out)[3]["observation.images.left"]["bytes"]
    assert file.startswith(b"\x89PNG")
    shown = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(cv2.cvtColor(shown, cv2.COLOR_BGR2RGB), expected)


def test_the_figures_are_those_of_the_numbers(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,))), out, video=False)
    whole, per_episode, rows = load(out / "meta/stats.json"), episodes(out), table(out)
    assert set(whole) == set(load(out / "meta/info.json")["features"])
    for key in ("observation.state", "action", "age.state", "timestamp", "next.done"):
        parts = [rows, *(rows[i * VERDICT : (i + 1) * VERDICT] for i in range(3))]
        found = [whole[key]]
        found += [{n: r[f"stats/{key}/{n}"] for n in whole[key]} for r in per_episode]
        for part, stats in zip(parts, found, strict=True):
            values = np.array([row[key] for row in part], dtype=float).reshape(len(part), -1)
            assert stats["count"] == [len(part)]
            np.testing.assert_allclose(stats["min"], values.min(axis=0))
            np.testing.assert_allclose(stats["max"], values.max(axis=0))
            np.testing.assert_allclose(stats["mean"], values.mean(axis=0), atol=1e-12)
            np.testing.assert_allclose(stats["std"], values.std(axis=0), atol=1e-12)
            for name, part_below in QUANTILES.items():
                np.testing.assert_allclose(stats[name], np.quantile(values, part_below, axis=0))


def test_the_figures_of_pictures_are_those_of_every_fourth(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d"), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,))), out, video=False)
    stats = load(out / "meta/stats.json")["observation.images.left"]
    seen = [e.picture("left", f) for e in collected_episodes([root]) for f in range(0, VERDICT, 4)]
    pixels = np.concatenate([picture.reshape(-1, 3) for picture in seen]) / 255
    assert stats["count"] == [len(seen)]
    for name, expected in (
        ("min", pixels.min(axis=0)),
        ("max", pixels.max(axis=0)),
        ("mean", pixels.mean(axis=0)),
        ("std", pixels.std(axis=0)),
        ("q10", np.quantile(pixels, 0.1, axis=0, method="inverted_cdf")),
        ("q99", np.quantile(pixels, 0.99, axis=0, method="inverted_cdf")),
    ):
        assert np.shape(stats[name]) == (3, 1, 1)
        np.testing.assert_allclose(np.reshape(stats[name], 3), expected, atol=1e-9)


def test_several_tasks_and_the_tail(tmp_path: Path) -> None:
    roots = (make(tmp_path / "a", ("success",)), make(tmp_path / "b", task="hardware/tool"))
    out = tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection(roots, tail=True)), out)
    rows = table(out)
    assert len(rows) == 4 * FRAMES
    assert [row["task_index"] for row in rows[::FRAMES]] == [0, 1, 1, 1]
    assert [row["next.success"] for row in rows[:FRAMES]] == [
        i >= VERDICT - 1 for i in range(FRAMES)
    ]
    assert [row["next.done"] for row in rows[:FRAMES]] == [i == FRAMES - 1 for i in range(FRAMES)]
    goals = [find_task(task).goal for task in ("door/unlock", "hardware/tool")]
    assert [row["tasks"] for row in episodes(out)] == [[goals[0]], *[[goals[1]]] * 3]
    assert pq.read_table(out / "meta/tasks.parquet")["task"].to_pylist() == goals


def test_odd_sizes_make_no_video(tmp_path: Path) -> None:
    source = select_episodes(EpisodeSelection((make(tmp_path / "d"),), width=25, height=SIZE[1]))
    with pytest.raises(DatasetError, match="25x32"):
        lerobot.write(source, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d"]


def test_the_frame_whose_neighbours_are_compared_has_one_before_it() -> None:
    for lengths in ((5, 5), (4, 6), (3, 3, 3), (2, 1, 4)):
        data = [{"frame_index": frame} for length in lengths for frame in range(length)]
        assert data[middle_frame(data)]["frame_index"] > 0


def test_something_rare_does_not_blow_up_when_it_is_scaled_by_quantiles(tmp_path: Path) -> None:
    walked = rows(0, 300)
    walked.rows["action/locomotion"] = [6 if frame == 40 else 0 for frame in range(300)]
    root = make(tmp_path / "d", ("success",), rows_of={0: walked}, size=None)
    out = tmp_path / "out"
    source = select_episodes(EpisodeSelection((root,), tail=True))
    (note,) = lerobot.write(source, out)
    assert "locomotion" in note
    assert "min and max" in note
    actions = np.array([row["action"] for row in table(out)])
    stats = load(out / "meta/stats.json")["action"]
    for low, high in (("q01", "q99"), ("q10", "q90")):
        least, most = np.array(stats[low]), np.array(stats[high])
        scaled = 2 * (actions - least) / (most - least) - 1
        assert np.abs(scaled[:, 16]).max() == 1.0
        assert np.abs(scaled).max() < 201.0
    (row,) = episodes(out)
    assert (row["stats/action/q01"][16], row["stats/action/q99"][16]) == (0.0, 6.0)
    # Held until it has been walked it is not rare any more.
    walked.rows["observation/control_state"] = [3 if 40 < f < 110 else 1 for f in range(300)]
    root = make(tmp_path / "w", ("success",), rows_of={0: walked}, size=None)
    held = EpisodeSelection((root,), tail=True, columns=ExportColumns(gait="held"))
    assert lerobot.write(select_episodes(held), tmp_path / "held") == []
    gaits = [row["action"][16] for row in table(tmp_path / "held")]
    assert gaits == [6.0 if 40 <= frame < 110 else 0.0 for frame in range(300)]


def test_quantiles_that_differ_are_left_as_they_are() -> None:
    values = np.random.default_rng(0).normal(size=(200, 2))
    values[:, 1] = 3.0
    stats = column_stats(values)
    assert stats["q01"][0] == np.quantile(values[:, 0], 0.01)
    assert stats["q01"][1] == stats["q99"][1] == 3.0
    assert rare_columns(values) == []


def test_the_parts_for_gr00t_and_the_cameras(tmp_path: Path) -> None:
    root, out = make(tmp_path / "d", ("success",)), tmp_path / "out"
    columns = ExportColumns(parts=("hands", "grippers"), gait="one-hot")
    source = select_episodes(EpisodeSelection((root,), width=24, height=16, columns=columns))
    lerobot.write(source, out)
    modality, info = load(out / "meta/modality.json"), load(out / "meta/info.json")
    assert modality["state"]["right_hand"] == {"start": 7, "end": 14}
    assert modality["action"]["locomotion"] == {"start": 16, "end": 23}
    assert info["features"]["observation.state"]["shape"] == [16]
    assert info["features"]["action"]["names"][16:18] == ["gait.none", "gait.forward"]
    assert modality["video"]["left"]["original_key"] in info["features"]
    (cameras,) = load(out / "meta/trill.json")["cameras"]
    assert cameras["collected_at"] == list(SIZE)
    assert cameras["left"]["camera_matrix"][0][2] == 11.5
    focal = 0.5 * SIZE[1] / np.tan(np.radians(60.0))
    assert cameras["right"]["camera_matrix"][1][1] == pytest.approx(focal / 2)
    card = (out / "README.md").read_text()
    assert "x forward, y left, z up" in card
