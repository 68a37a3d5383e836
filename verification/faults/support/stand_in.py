"""Stand-ins for a person and for a policy, which walk and reach whenever they have the robot.

``python -m verification.faults.support.stand_in --role person|policy``, with the options of every
service. The person asks for the robot on SIGUSR1, begins at the present target, and gives the robot
back on SIGUSR2. The policy waits for a free robot and sends set-points of its own all the time.
Both print what became of a gait that was not completed.
"""

import signal
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from itertools import cycle
from math import cos, sin
from typing import NamedTuple

import numpy as np

from common.operator.claim import Claimant, own_replies
from common.robot.pose import Pose
from common.runtime.live.main import run_live
from common.runtime.service import Inputs, Output, Service
from common.schemas import ControlState, Gait, Header, OperatorKind, Sender
from common.topics import (
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.errors import ScriptError
from services.teleop.scripted.gaits import GaitClient
from services.teleop.targets.hand import SIDES, home_pose
from services.teleop.targets.targets import OperatorTargets

MODULE = "verification.faults.support.stand_in"
TAKE, GIVE_BACK = signal.SIGUSR1, signal.SIGUSR2
READY = "hears the controller"
"""Printed when the first state of the controller arrives."""
ENDED = "was aborted"
"""Part of what is printed when the controller ends a gait early."""
GAITS = (Gait.FORWARD, Gait.BACKWARD)
"""Walked in turn, so that the robot stays about where it is."""
RADIUS, RATE = 0.04, 1.5
"""Of the circles of the hands [m, rad/s]."""


class Role(NamedTuple):
    """An operator: name of the service, kind, and where its hands are from home [m]."""

    name: str
    kind: OperatorKind
    reach: tuple[float, float, float]


ROLES = {
    "person": Role("keyboard", OperatorKind.PERSON, (0.0, 0.0, 0.0)),
    "policy": Role("policy", OperatorKind.POLICY, (0.06, 0.0, 0.10)),
}


class StandIn(Service):
    """Claims the robot as its kind does; walks and reaches while it has it."""

    period_ns = 50_000_000
    reads = (WBC_STATE, WBC_REPLY, WBC_AUTHORITY, WBC_TARGET)
    writes = (TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT)

    def __init__(self, role: Role) -> None:
        self.name = role.name
        self._role = role
        self._claimant = Claimant(role.kind)
        self._targets = OperatorTargets()
        self._gaits = GaitClient()
        self._order = cycle(GAITS)
        self._walk: Iterator[None] | None = None
        self._had = self._ready = False
        self._time = 0.0
        signal.signal(TAKE, lambda *_: self._claimant.ask(self._time))
        signal.signal(GIVE_BACK, lambda *_: self._claimant.release())

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Claim, move the hands and ask for the next gait."""
        dt = 1e-9 * self.period_ns
        self._time += dt
        if not self._gaits.next_id:
            self._gaits.next_id = now_ns // 1_000_000
        self._claimant.update(inputs, Sender(self.name, self.boot), stopped=False)
        controller = inputs.latest(WBC_STATE) if inputs.fresh(WBC_STATE) else None
        self._gaits.update(dt, own_replies(inputs.events(WBC_REPLY), self.boot), controller)
        if controller is not None and not self._ready:
            self._ready = True
            print(READY, flush=True)
        stamp = 0 if controller is None else controller.header.stamp
        outputs = self._claimant.claims(now_ns, stamp)
        has, policy = self._claimant.has_robot, self._role.kind is OperatorKind.POLICY
        target = inputs.latest(WBC_TARGET)
        if has and not self._had and not policy and target is not None:
            self._targets.adopt(target)
        self._had = has
        if has or policy:
            self._move_hands(dt)
            outputs.append(Output(TELEOP_SETPOINT, self._targets.setpoint(stamp)))
        if has and controller is not None and controller.state is ControlState.BALANCE:
            self._walk = self._walk or self._gaits.perform(next(self._order))
        self._continue_walk()
        requests, self._gaits.outbox = self._gaits.outbox, []
        header = Header(stamp=stamp)
        return outputs + [
            Output(TELEOP_GAIT, request.model_copy(update={"header": header}))
            for request in requests
        ]

    def _move_hands(self, dt: float) -> None:
        angle = RATE * self._time
        away = np.array(self._role.reach) + RADIUS * np.array([0.0, cos(angle), sin(angle)])
        for side in SIDES:
            home = home_pose(side)
            self._targets.hands[side].go_to(Pose(home.position + away, home.quaternion))
        self._targets.advance(dt)

    def _continue_walk(self) -> None:
        if self._walk is None:
            return
        try:
            next(self._walk)
        except StopIteration:
            self._walk = None
        except ScriptError as error:
            print(error, flush=True)
            self._walk = None


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--role", choices=ROLES, required=True)


def _build(arguments: Namespace) -> StandIn:
    return StandIn(ROLES[arguments.role])


if __name__ == "__main__":
    name = next(role.name for word, role in ROLES.items() if word in sys.argv)
    raise SystemExit(run_live(_build, name, add_arguments=_add_arguments))
