"""The operator of the how-to works as printed."""

import re
from typing import Any

import pytest

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import AuthorityChange, AuthorityState, PlantStatus, Setpoint
from common.topics import PLANT_STATUS, WBC_AUTHORITY, WBC_TARGET
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.wbc.service import WbcService

from .pages import ROOT


def test_the_operator_of_the_how_to_lifts_the_hand_and_gives_the_robot_back() -> None:
    text = (ROOT / "docs/how-to/add-an-operator.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    assert code[1].count("\n") <= 65
    names: dict[str, Any] = {"__name__": "lifter"}
    exec(compile(code[1], "lifter.py", "exec"), names)

    operator = names["Lifter"]()
    runner = SimTimeRunner([PlantService(SimConfig(physics_steps=5)), WbcService(), operator])
    decisions: list[AuthorityState] = []
    heights: list[float] = []
    statuses: list[PlantStatus] = []
    runner.on_message(WBC_AUTHORITY, decisions.append)
    runner.on_message(PLANT_STATUS, statuses.append)

    def note(target: Setpoint) -> None:
        heights.append(float(target.left_hand_position_in_body[2]))

    runner.on_message(WBC_TARGET, note)
    runner.run_for(6.0)

    assert operator.exit_code == 0
    assert {state.holder for state in decisions} == {"", "bridge"}
    assert decisions[-1].change is AuthorityChange.RELEASED
    assert heights[-1] - heights[0] == pytest.approx(0.05, abs=0.003)
    assert not statuses[-1].fallen
