"""Operators and a controller that they claim the robot from, under a test's control."""

from dataclasses import dataclass

from common.schemas import AuthorityState, OperatorClaim, OperatorKind, Sender
from services.wbc.authority import Authority
from services.wbc.config import AuthorityConfig

from .support import claim

PERSON, SCRIPT, POLICY = OperatorKind.PERSON, OperatorKind.SCRIPT, OperatorKind.POLICY
CONFIG = AuthorityConfig()
TICK = 50_000_000
LISTENED = 2 * 10**9
"""Robot time at which a new controller has listened long enough [ns]."""


@dataclass
class Operator:
    """An operator under the test's control; it is heard in every update until it is silent."""

    sender: Sender
    kind: OperatorKind
    wants: bool = True
    act: int = 0
    holding: bool = False
    silent: bool = False
    seq: int = -1

    def says(self) -> OperatorClaim:
        self.seq += not self.silent
        return claim(
            max(self.seq, 0),
            self.sender,
            self.kind,
            wants=self.wants,
            act=self.act,
            holding=self.holding,
        )


class Table:
    """Operators and a controller that they claim the robot from."""

    def __init__(
        self, *operators: Operator, now: int = 0, config: AuthorityConfig = CONFIG
    ) -> None:
        self.operators = list(operators)
        self.authority = Authority(config)
        self.now = now
        self.stopped = False

    def update(self, ticks: int = 1) -> list[AuthorityState]:
        changes = []
        for _ in range(ticks):
            self.now += TICK
            heard = [one for one in self.operators if one.seq >= 0 or not one.silent]
            claims = {one.sender: one.says() for one in heard}
            changes += self.authority.update(self.now, claims, stopped=self.stopped)
        return changes

    def settle(self) -> "Table":
        """Until the controller has listened long enough."""
        self.update(21)
        return self

    @property
    def holder(self) -> str:
        return "" if self.authority.holder is None else self.authority.holder.source


def person(name: str = "keyboard", boot: int = 1, act: int = 0) -> Operator:
    return Operator(Sender(name, boot), PERSON, wants=act > 0, act=act)


def script(name: str = "teleop", boot: int = 2) -> Operator:
    return Operator(Sender(name, boot), SCRIPT, act=1)


def policy(name: str = "policy", boot: int = 3) -> Operator:
    return Operator(Sender(name, boot), POLICY)


def acts(operator: Operator) -> None:
    operator.wants, operator.act = True, operator.act + 1
