"""A guard that has just been reset, and one that obeys."""

import pytest

from common.plant.config import GuardConfig
from common.plant.guard import Guard
from tests.services.sim.support import make_command

from .support import EPOCH, NOW, offer


@pytest.fixture
def guard() -> Guard:
    guard = Guard(GuardConfig(hold_after=0.1, damp_after=5.0))
    guard.reset(EPOCH)
    return guard


@pytest.fixture
def active(guard: Guard) -> Guard:
    assert offer(guard, make_command(NOW), NOW)
    return guard
