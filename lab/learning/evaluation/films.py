"""Films trials: runs each again, which goes the same, and draws what happened."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from lab.errors import LabError
from lab.learning.evaluation.summary import Trial, label_of
from lab.review.frames import Image, write_picture
from lab.review.key_moments import Moment
from lab.review.task_moments import trial_seconds
from lab.review.tiles import moment_tiles
from lab.trials.campaign import Executor, run_campaign
from lab.trials.spec import TrialSpec
from services.sim.rendering.render import contact_sheet

TILE = (240, 180)
"""Width and height of a picture of the contact sheet [pixels]."""
COLUMNS = 5
"""Moments of a trial on the contact sheet."""
MOST_ROWS = 12
"""Trials on the contact sheet."""


def film_name(spec: TrialSpec) -> str:
    """Return the file name of a trial's video."""
    words = f"{label_of(spec)} {spec.task} {spec.seed:04d}"
    return "-".join("".join(c if c.isalnum() else " " for c in words).split()) + ".mp4"


def film(folder: Path, spec: TrialSpec) -> list[Image]:
    """Run a trial in a worker, write its video, and return its pictures for the contact sheet.

    Raises:
        StoppedError: the worker is to end meanwhile.
        RenderingUnavailableError: there is no off-screen OpenGL.
        LabError: FFmpeg failed.
    """
    # Robot, controller and renderer take long to import, and the workers alone need them.
    from lab.review.pictures import write_video
    from lab.studies.tasks.pictures import record_trial

    result, timeline = record_trial(spec)
    write_video(folder / film_name(spec), timeline, lambda _done, _total: None)
    last = len(timeline.truth) - 1
    labels = [f"seed {spec.seed}", label_of(spec), *[""] * (COLUMNS - 3), result.verdict]
    indices = np.linspace(0, last, COLUMNS).round().astype(int).tolist()
    moments = list(map(Moment, indices, labels))
    return moment_tiles(
        timeline, moments, TILE, None, partial(trial_seconds, timeline), lambda _done, _total: None
    )


def film_failures(
    trials: Sequence[Trial],
    folder: Path,
    open_executor: Callable[[], Executor],
    on_film: Callable[[Path], None] = lambda _path: None,
    on_message: Callable[[str], None] = lambda _text: None,
) -> Path | None:
    """Write a video of each trial that was no success, and a contact sheet of the first ones.

    Videos that are there are not made again, unless the contact sheet needs their trials.

    Args:
        trials: the trials.
        folder: of the videos.
        open_executor: makes the workers.
        on_film: called with each new video.
        on_message: called with what the user should know of the workers.

    Returns:
        the contact sheet; None: there was no failure.

    Raises:
        LabError: a file cannot be written.
    """
    failed = [spec for spec, result in trials if result.verdict != "success"]
    if not failed:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LabError(f"--videos: cannot use {folder}: {error.strerror}") from error
    sheet = folder / "failures.png"
    missing = [spec for spec in failed if not (folder / film_name(spec)).exists()]
    if not missing and sheet.exists():
        return sheet
    rows: dict[str, list[Image]] = {}

    def keep(spec: TrialSpec, tiles: list[Image]) -> None:
        rows[spec.key] = tiles
        on_film(folder / film_name(spec))

    todo = [*missing, *(spec for spec in failed[:MOST_ROWS] if spec not in missing)]
    run_campaign(
        todo, partial(film, folder), open_executor(), on_result=keep, on_message=on_message
    )
    tiles = [tile for spec in failed[:MOST_ROWS] for tile in rows[spec.key]]
    write_picture(sheet, contact_sheet(tiles, COLUMNS))
    return sheet
