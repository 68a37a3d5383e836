"""Pictures of a trial as a file, where there is a graphics library."""

from pathlib import Path

import cv2
import pytest

from lab.errors import LabError
from lab.review.timeline import read_timeline
from lab.studies.tasks.command import main
from lab.studies.tasks.pictures import LARGEST, write_sheet
from lab.trials.spec import TrialResult
from services.sim.errors import RenderingUnavailableError
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import unlocked

RESULT = TrialResult(task="door/unlock", seed=7, verdict="success", time=6.0, reason="it was")


def test_a_sheet_is_small_and_has_three_rows(tmp_path: Path) -> None:
    timeline = read_timeline(unlocked(FakeRobot()))
    path = tmp_path / "new" / "sheet.jpg"
    try:
        write_sheet(RESULT, timeline, path)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert 20_000 < path.stat().st_size <= LARGEST
    sheet = cv2.imread(str(path))
    assert sheet is not None
    height, width, _ = sheet.shape
    assert 1.5 < width / height < 2.0
    # Below two rows from outside there are the left camera's images.
    image = sheet[-height // 4 :, : width // 5]
    assert image.std() > 10.0
    assert image.mean() < 240.0
    with pytest.raises(LabError, match="expected a name like sheet"):
        write_sheet(RESULT, timeline, tmp_path / "sheet.hue")


def test_a_file_cannot_hold_all_tasks(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pictures", "all", "--out", "one.jpg"]) == 2
    assert "expected a directory for several tasks, got one.jpg" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("out", "words"), [("s.txt", "expected a name like sheet"), ("file/s.jpg", "cannot make")]
)
def test_a_place_where_no_sheet_can_be_is_told_before_the_trial(
    out: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setattr(
        "lab.studies.tasks.pictures.record_trial", lambda _: pytest.fail("it was run")
    )
    assert main(["pictures", "door/unlock", "--out", str(tmp_path / out)]) == 1
    assert words in capsys.readouterr().err
