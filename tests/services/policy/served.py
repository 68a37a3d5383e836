"""A policy without a network: hand-made answers, whose set-points tell the step they are for."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from common.robot.kinematics import FORWARD_HAND
from common.schemas import Gait
from services.policy.checkpoint.manifest import (
    NETWORK,
    PROCESSOR,
    Description,
    Manifest,
    Origin,
    schema_of,
    sha256,
)
from services.policy.configuration import ChunkConfig, InputConfig, PolicySettings
from services.policy.kinds import network
from services.policy.processor.actions import AbsoluteChunks
from services.policy.processor.processor import Decision, Processor
from services.policy.service import PolicyConfig, PolicyOperator
from services.policy.serving.engine import Answer, Request
from tests.services.policy.made import episode, small

ORIGIN = Origin(dataset="none", episodes=3, source="none", versions={}, operator="nobody")
BLIND = small(
    "trill", inputs=InputConfig(vision="blind", picture_size=(24, 18)), actions=ChunkConfig()
)


def description_of(settings: PolicySettings = BLIND) -> Description:
    """Describe a policy that was fitted to three made episodes."""
    processor = Processor.fit(settings, [episode(seed) for seed in range(3)])
    content = processor.model_dump_json(indent=1).encode()
    manifest = Manifest.model_validate(
        {
            "policy": settings.model_dump(),
            "interface": schema_of(settings),
            "tensors": {},
            "origin": ORIGIN,
            "digests": {PROCESSOR: sha256(content), NETWORK: sha256(b"")},
        }
    )
    return Description(manifest=manifest, processor=processor, digest="ab" * 32)


def saved(folder: Path, settings: PolicySettings, seed: int = 0) -> Path:
    """Write a checkpoint with random weights; it needs torch."""
    import torch

    from services.policy.checkpoint.folder import save_checkpoint

    torch.manual_seed(seed)
    processor = Processor.fit(settings, [episode(number) for number in range(3)])
    save_checkpoint(folder, network(settings), processor, ORIGIN)
    return folder


def reaching(step: float) -> tuple[float, float]:
    """Return x of left and right hand that the made answers have for a step [m]."""
    return 0.30 + 0.08 * np.sin(0.05 * step), 0.30 - 0.08 * np.sin(0.05 * step)


def gait_of(gait: Gait, probability: float = 1.0) -> Any:
    """Return the probabilities of one gait."""
    found = np.zeros(len(Gait), dtype=np.float32)
    found[0], found[gait] = 1.0 - probability, probability
    return found


class MadeEngine:
    """Answers chunks in which the hands reach as :func:`reaching` says, ``delay`` steps late.

    Attributes:
        requests: all so far.
        delay: steps from a request to its answer, counted in calls of :meth:`answers`.
        silent: whether requests are not answered at all.
        gait: what each answer says about gaits.
    """

    refused, problem, waiting = 0, "", True

    def __init__(self, description: Description, delay: int = 0) -> None:
        self.requests: list[Request] = []
        self.delay, self.silent, self.closed = delay, False, False
        self.gait: Callable[[Request], Any] = lambda _request: gait_of(Gait.NONE)
        self._processor = description.processor
        self._due: list[tuple[int, Answer]] = []
        self._step = -1

    def ask(self, request: Request) -> None:
        self.requests.append(request)
        if not self.silent:
            self._due.append((request.step + self.delay, self.answer(request)))

    def answer(self, request: Request) -> Answer:
        steps = self._processor.actions.shape[0]
        hands = np.zeros((steps, 14))
        for i in range(steps):
            left, right = reaching(request.step + i)
            hands[i] = [left, 0.2, 0.05, *FORWARD_HAND, right, -0.2, 0.05, *FORWARD_HAND]
        chunk = AbsoluteChunks(ChunkConfig(active_time=False))
        rows = chunk.encode(hands, np.zeros(steps), np.arange(steps)[None])[0]
        grasp = np.tile(np.array([0.9, 0.1], dtype=np.float32), (steps, 1))
        decision = Decision(self._processor.action.normalise(rows), grasp, self.gait(request))
        return Answer(request.step, decision, request.memory + 1.0)

    def advance(self, step: int) -> None:
        """Say which step it is, where the requests do not."""
        self._step = step

    def work(self) -> None:
        pass

    def answers(self) -> list[Answer]:
        now = max([self._step, *(request.step for request in self.requests)])
        due = [answer for at, answer in self._due if at <= now]
        self._due = [(at, answer) for at, answer in self._due if at > now]
        return due

    def close(self) -> None:
        self.closed = True


class MadePolicy(PolicyOperator):
    """The service with a made engine, which it tells each step."""

    def __init__(self, engine: MadeEngine, description: Description, **config: Any) -> None:
        super().__init__(PolicyConfig(checkpoint=Path("none"), **config), engine, description)
        self.engine = engine
        self.made = engine
        self.steps = 0

    def step(self, inputs: Any, now_ns: int) -> Any:
        self.made.advance(self.steps)
        self.steps += 1
        return super().step(inputs, now_ns)


def made_policy(delay: int = 0, **config: Any) -> tuple[MadePolicy, MadeEngine]:
    """Return a policy of chunks without pictures, and its engine."""
    description = description_of()
    engine = MadeEngine(description, delay)
    return MadePolicy(engine, description, **config), engine
