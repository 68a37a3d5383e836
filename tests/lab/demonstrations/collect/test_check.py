"""``trill collect --check`` finds each kind of damage, and nothing in what is whole."""

from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from common.episodes.columns import Rows
from common.episodes.episode_file import EpisodeMeta, to_bytes
from common.episodes.errors import EpisodeAccessError
from lab.cli.main import main
from lab.demonstrations.collect.check import check, remake
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig
from lab.demonstrations.collect.episode import EpisodeResult
from lab.demonstrations.collect.store import DatasetStore
from tests.common.episodes.test_episode_file import held_open
from tests.lab.demonstrations.collect.support import CODE, CONFIG, meta, rows

FRAMES = 6
PICTURED = CONFIG.model_copy(update={"pictures": PictureConfig(width=32, height=16)})


def about(config: EpisodeConfig, seed: int, verdict: str, **changes: object) -> EpisodeMeta:
    """Metadata of an episode made with ``config``."""
    size = None if config.pictures is None else (config.pictures.width, config.pictures.height)
    given = {"origin": config.origin(), "picture_size": size, **changes}
    return meta(seed, verdict, FRAMES).model_copy(update=given)


def whole(seed: int) -> Rows:
    """Frames as a real trial's could be."""
    made = rows(FRAMES, seed)
    now = [50_000_000 * (i + 3) for i in range(FRAMES)]
    made.rows["time/robot_ns"] = list(now)
    for name in ("state", "controller", "picture", "truth", "seen"):
        made.rows[f"time/{name}_ns"] = [stamp - 5_000_000 for stamp in now]
    unit = [1.0, 0.0, 0.0, 0.0]
    made.rows["observation/poses"] = [np.array([0.1, 0.2, 0.3, *unit] * 4)] * FRAMES
    made.rows["action/hands"] = [np.array([0.1, 0.2, 0.3, *unit] * 2)] * FRAMES
    made.rows["truth/base_quaternion"] = [np.array(unit)] * FRAMES
    return made


@pytest.fixture
def store(tmp_path: Path) -> DatasetStore:
    """Two episodes and a failure."""
    made = DatasetStore(tmp_path)
    _, jpeg = cv2.imencode(".jpg", np.full((16, 32, 3), 90, dtype=np.uint8))
    pictures = {camera: [jpeg.tobytes()] * FRAMES for camera in ("left", "right")}
    with made.writing(PICTURED, CODE):
        for seed, verdict in ((0, "success"), (1, "failure"), (2, "success")):
            of = about(PICTURED, seed, verdict)
            content = to_bytes(of, whole(seed), pictures) if verdict == "success" else None
            made.add(of, content)
    return made


def test_nothing_is_wrong_with_what_is_whole(store: DatasetStore) -> None:
    assert check(store) == []
    assert main(["collect", "--check", str(store.root)]) == 0


def test_an_episode_from_before_a_column_was_added_is_whole(store: DatasetStore) -> None:
    with h5py.File(store.root / "episodes" / "000000.h5", "r+") as file:
        del file["observation/hand_error"]
    store.write_index(store.scan())
    assert check(store) == []


def put(path: str, index: tuple[int, ...], value: float) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[path][index] = value

    return change


def _shorter(file: h5py.File) -> None:
    values = file["action/neck"][:-1]
    del file["action/neck"]
    file["action/neck"] = values


def _spoilt(file: h5py.File) -> None:
    begin, end = file["images/right/offset"][3:5]
    file["images/right/data"][begin:end] = 0


def _gone(file: h5py.File) -> None:
    del file["images"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("observation/joint_velocity", (2, 3), np.nan), "not a finite number in frame 2"),
        (put("action/hands", (4, 3), 1.1), "action/hands: a quaternion"),
        (put("truth/base_quaternion", (1, 0), 0.9), "truth/base_quaternion: a quaternion"),
        (put("time/robot_ns", (3,), 1), "from frame 2 to 3, expected 50"),
        (put("time/state_ns", (3,), 7), "time/state_ns goes back in frame 3"),
        (put("time/seen_ns", (5,), 1e12), "time/seen_ns is of the future in frame 5"),
        (_shorter, "action/neck: expected <f8 (6,), got <f8 (5,)"),
        (_spoilt, "right camera, frame 3: no picture"),
        (_gone, "has no pictures, against its metadata"),
    ],
)
def test_damage_is_told_with_file_and_frame(
    store: DatasetStore, change: Callable[[h5py.File], None], words: str
) -> None:
    path = store.root / "episodes" / "000002.h5"
    with h5py.File(path, "r+") as file:
        change(file)
    store.write_index(store.scan())
    found = check(store)
    assert any(text.startswith("episodes/000002.h5: ") and words in text for text in found), found
    assert not any("000000" in text for text in found)


def _no_array(file: h5py.File) -> None:
    del file["action/neck"]
    file["action/neck"] = np.dtype("f8")


def _no_meta(file: h5py.File) -> None:
    del file.attrs["meta"]


@pytest.mark.parametrize("change", [_no_array, _no_meta])
def test_what_hdf5_stumbles_over_is_damage_like_any_other(
    store: DatasetStore, change: Callable[[h5py.File], None]
) -> None:
    with h5py.File(store.root / "episodes" / "000000.h5", "r+") as file:
        change(file)
    found = check(store)
    assert any(t.startswith("episodes/000000.h5: ") and "damaged" in t for t in found), found
    assert not any("000002" in text for text in found)


def test_an_index_that_is_no_text_is_told(store: DatasetStore) -> None:
    path = store.root / "index.jsonl"
    content = bytearray(path.read_bytes())
    content[40] ^= 0x80
    path.write_bytes(content)
    (found,) = check(store)
    assert "--reindex" in found


def test_robot_time_in_steps_that_do_not_fit_is_right(tmp_path: Path) -> None:
    for steps, tolerance, unevenness in ((3, 0.003, 0), (5, 0.0, 1)):
        config = CONFIG.model_copy(update={"physics_steps": steps})
        of = about(config, 0, "success", frame_tolerance=tolerance)
        given = whole(0)
        given.rows["time/robot_ns"] = [(50 * (i + 3)) // 3 * 3_000_000 for i in range(FRAMES)]
        store = DatasetStore(tmp_path / f"{steps}")
        with store.writing(config, CODE):
            store.add(of, to_bytes(of, given, {}))
        assert sum("expected 50" in text for text in check(store)) == unevenness


def test_the_index_and_the_files_are_compared(
    store: DatasetStore, capsys: pytest.CaptureFixture[str]
) -> None:
    path = store.root / "episodes" / "000000.h5"
    with h5py.File(path, "r+") as file:
        file["action/neck"][0] = 0.25
    (found,) = check(store)
    assert "SHA-256" in found
    path.write_bytes(path.read_bytes()[:900])
    (store.root / "rejected" / "000001.json").unlink()
    (store.root / "episodes" / "000007.h5").write_bytes(
        (store.root / "episodes" / "000002.h5").read_bytes()
    )
    assert main(["collect", "--check", str(store.root)]) == 1
    said = capsys.readouterr().out
    assert "000000.h5: cannot read" in said
    assert "rejected/000001.json: in the index, but not there" in said
    assert "000007.h5: expected the trial of its name, got seed 2" in said
    assert "3 trials read; 4 wrong" in said
    (store.root / "index.jsonl").write_text('{"file": "epis')
    assert any("--reindex" in text for text in check(store))


def test_flags_that_contradict(store: DatasetStore) -> None:
    of = about(PICTURED, 2, "failure", source="")
    (store.root / "episodes" / "000002.h5").write_bytes(to_bytes(of, whole(2), {}))
    store.write_index(store.scan())
    found = "\n".join(check(store))
    assert "kept, but its verdict is failure" in found
    assert "does not say which code" in found


def test_a_place_where_no_sheet_can_be_is_told(
    store: DatasetStore, capsys: pytest.CaptureFixture[str]
) -> None:
    below = store.root / "dataset.json" / "sheet.png"
    assert main(["collect", "--info", str(store.root), "--sheet", str(below)]) == 1
    assert "cannot write" in capsys.readouterr().err


def test_wrong_questions(store: DatasetStore, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["collect", "door/unlock", "--remake", "3"]) == 2
    assert "--check" in capsys.readouterr().err
    assert main(["collect", "--check", str(store.root / "none")]) == 1
    assert "no data set" in capsys.readouterr().err
    assert main(["collect", "--check", str(store.root), "--remake", "9"]) == 1
    assert "no trial with seed 9" in capsys.readouterr().err


def test_an_episode_that_another_program_has_open_is_not_to_be_moved_away(
    store: DatasetStore, capsys: pytest.CaptureFixture[str]
) -> None:
    with held_open(store.root / "episodes" / "000002.h5"):
        with pytest.raises(EpisodeAccessError, match=r"000002(.|\n)*another program") as error:
            store.scan()
        assert "damaged" not in str(error.value)
        found = check(store)
        assert main(["dataset", "export", str(store.root), "--format", "robomimic"]) == 1
    assert [text for text in found if "another program" in text] == found[:1]
    assert "damaged" not in "".join(found) + capsys.readouterr().err
    assert check(store) == []


def test_other_bytes_on_another_processor_are_told_as_such(
    store: DatasetStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = store.read(store.root / "episodes" / "000002.h5").meta

    def made_here(_config: EpisodeConfig, _seed: int) -> EpisodeResult:
        of = before.model_copy(update={"machine": machine})
        return EpisodeResult(of, b"other", simulated=1.0, wall=1.0)

    monkeypatch.setattr("lab.demonstrations.collect.check.make_episode", made_here)
    machine = "x86_64 SSE2; BLAS Prescott"
    assert "another kind of processor" in (told := remake(store, 2))
    assert machine in told
    machine = before.machine
    assert "by the same code" in remake(store, 2)
