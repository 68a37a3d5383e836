"""Run tests of the wire in Python and in compiled code."""

import pytest

from common.wire import codec, template


@pytest.fixture(params=["python", "compiled"])
def compiled_or_not(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a test in both ways; the second one is skipped where the kernels are not built."""
    if request.param == "python":
        monkeypatch.setattr(codec, "_codec", None)
        monkeypatch.setattr(template, "_template", None)
    elif codec._codec is None or template._template is None:
        pytest.skip("the kernels are not built")
