"""Exports in the hands of robomimic and lerobot themselves, where these are installed.

``make loaders`` installs them, each into a venv of its own.
"""

from importlib.metadata import version
from pathlib import Path

import pytest

from lab.demonstrations.export import lerobot, robomimic
from lab.demonstrations.export.selection import EpisodeSelection, select_episodes
from tests.lab.demonstrations.export.support import VERDICT, make
from verification.loaders import lerobot_check, robomimic_check
from verification.loaders.torchvision_shim import declare_torchvision_operators


@pytest.mark.parametrize("scaled", [False, True])
def test_robomimic_loads_it(scaled: bool, tmp_path: Path) -> None:
    pytest.importorskip("robomimic")
    root, out = make(tmp_path / "d"), tmp_path / "out.hdf5"
    robomimic.write(
        select_episodes(EpisodeSelection((root,))), out, scale_actions=scaled, compress=scaled
    )
    report = robomimic_check.check(out, [root], train=False)
    assert report["frames"] == 3 * VERDICT
    assert report["pictures equal"] == 2 * 3 * VERDICT


@pytest.mark.parametrize("video", [False, True])
def test_lerobot_loads_it(video: bool, tmp_path: Path) -> None:
    pytest.importorskip("lerobot")
    declare_torchvision_operators()
    torchvision = pytest.importorskip("torchvision")
    if video and version("lerobot") < "0.6" and not hasattr(torchvision.io, "VideoReader"):
        pytest.skip("this lerobot decodes video by torchvision, and this torchvision does not")
    root, out = make(tmp_path / "d"), tmp_path / "out"
    lerobot.write(select_episodes(EpisodeSelection((root,))), out, video=video)
    report = lerobot_check.check(out, [root], train=False)
    assert report["frames"] == 3 * VERDICT
