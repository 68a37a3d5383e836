"""The rig that takes a policy's inference server away, for one round."""

import pytest

pytest.importorskip("torch")
pytest.importorskip("safetensors")

from verification.faults.inference import DOUBLED, FAULTS, Inference


def test_a_robot_holds_without_its_inference_server_and_goes_on_by_itself() -> None:
    rows = {row["server"]: row for row in Inference(rounds=1).measure(lambda _text: None)}
    assert rows.keys() == {*FAULTS, DOUBLED}
    for name, row in rows.items():
        assert row["falls"] == 0
        assert row["moved [mm]"] == 0.0
        assert row["held"] == (name != DOUBLED)
        assert float(row["back max [s]"]) < float("inf")
