"""Short scripts run on an invented robot."""

from common.schemas import OperatorStatus
from common.topics import TELEOP_STATUS
from services.teleop.scripted.script import HandPose, Script, Step
from services.teleop.scripted.service import ScriptedConfig, ScriptedOperator

from .support import Bench, FakeController


def operator(*steps: Step, start_timeout: float = 60.0) -> ScriptedOperator:
    script = Script(name="t", steps=steps)
    return ScriptedOperator(script, ScriptedConfig(start_timeout=start_timeout))


def bench(*steps: Step, controller: FakeController | None = None) -> Bench:
    return Bench(operator(*steps), controller or FakeController())


def scripted(bench: Bench) -> ScriptedOperator:
    assert isinstance(bench.service, ScriptedOperator)
    return bench.service


def last_status(bench: Bench) -> OperatorStatus:
    status = bench.messages(TELEOP_STATUS)[-1]
    assert isinstance(status, OperatorStatus)
    return status


def left(x: float, y: float, z: float) -> HandPose:
    return HandPose(position=(x, y, z))
