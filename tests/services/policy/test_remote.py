"""Inference elsewhere: what travels, and a server that is killed, stopped, restarted, doubled."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("safetensors")

from common.errors import SchemaError
from common.inbox.inbox import Inbox
from common.runtime.live.components import RunnerContext
from common.transport.config import BusConfig
from common.transport.session import open_session
from services.policy.checkpoint.manifest import Description, describe
from services.policy.configuration import ChunkConfig
from services.policy.runtimes.load import load_runtime
from services.policy.serving.config import PolicyConfig
from services.policy.serving.engine import Answer, Request
from services.policy.serving.remote import NO_SERVER, RemoteEngine
from services.policy.serving.wire import ANSWER_TAG, REQUEST_TAG, WireFormat
from tests.common.transport.support import free_base_port
from tests.services.policy.made import small
from tests.services.policy.served import description_of, saved

STEREO = small("trill", actions=ChunkConfig(steps=6))
PATIENCE = 30.0


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / "made", STEREO)


def request(step: int, frames: int = 3) -> Request:
    rng = np.random.default_rng(step)
    width, height = STEREO.inputs.picture_size
    return Request(
        step,
        rng.normal(size=(frames, STEREO.inputs.width)).astype(np.float32),
        rng.integers(0, 255, (frames, 2, height, width, 3), dtype=np.uint8),
        rng.normal(size=STEREO.memory_shape).astype(np.float32),
    )


def same(got: Any, expected: Any) -> None:
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_requests_and_answers_are_what_they_were(checkpoint: Path) -> None:
    runtime, description = load_runtime(PolicyConfig(checkpoint=checkpoint))
    wire, asked = WireFormat(description), request(7)
    got = wire.unpack_request(wire.pack_request(asked), REQUEST_TAG)
    same(got, asked)
    decision, memory = runtime.run(*got[1:])
    answer = wire.unpack_answer(wire.pack_answer(Answer(7, decision, memory, 0.25)), ANSWER_TAG)
    assert (answer.step, answer.seconds) == (7, 0.25)
    same((*answer.decision, answer.memory), (*decision, memory))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: r._replace(memory=r.memory[:1]), "bytes of memory"),
        (lambda r: r._replace(pictures=r.pictures[:, :1]), "bytes of pictures"),
        (lambda r: r._replace(observations=r.observations * np.nan), "finite numbers in obs"),
    ],
)
def test_what_does_not_fit_the_checkpoint_is_refused(
    checkpoint: Path, change: Callable[[Request], Request], said: str
) -> None:
    wire = WireFormat(describe(checkpoint))
    with pytest.raises(SchemaError, match=said):
        wire.unpack_request(wire.pack_request(change(request(1))), REQUEST_TAG)


def test_another_checkpoint_another_schema_and_garbage_are_refused(checkpoint: Path) -> None:
    wire = WireFormat(describe(checkpoint))
    other = WireFormat(description_of(STEREO))
    with pytest.raises(SchemaError, match="expected the checkpoint"):
        wire.unpack_request(other.pack_request(request(1)), REQUEST_TAG)
    with pytest.raises(SchemaError, match="schema mismatch"):
        wire.unpack_request(wire.pack_request(request(1)), ANSWER_TAG)
    whole = wire.pack_request(request(1))
    rng = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(whole[: rng.integers(1, len(whole))])
        damaged[rng.integers(len(damaged))] ^= 0xFF
        with pytest.raises(SchemaError):
            wire.unpack_request(bytes(damaged), REQUEST_TAG)


class Player:
    """The robot's side of inference: an engine on the policy's port."""

    def __init__(self, description: Description) -> None:
        self.port = free_base_port(12)
        self.session: Any = open_session(BusConfig(base_port=self.port), "policy")
        self.engine = RemoteEngine(description, timeout=1.0)
        self.engine.open(
            RunnerContext(
                self.session, "draco3", "policy", 1, Inbox(()), lambda *_: None, lambda _: True
            )
        )

    def ask(self, step: int, answers: int = 1) -> list[Answer]:
        """Ask until so many servers answer one request."""
        got: list[Answer] = []
        deadline = time.monotonic() + PATIENCE
        while len(got) < answers:
            assert time.monotonic() < deadline, f"{self.engine.problem}, {len(got)} answers"
            self.engine.ask(request(step))
            got = self.drain()
        return got

    def drain(self) -> list[Answer]:
        """Return all answers to the last request."""
        got = self.engine.answers()
        while self.engine.waiting:
            time.sleep(0.005)
            got += self.engine.answers()
        return got

    @contextmanager
    def server(self, checkpoint: Path) -> Iterator["subprocess.Popen[bytes]"]:
        command = [sys.executable, "-m", "services.policy.server", str(checkpoint)]
        process = subprocess.Popen([*command, "--base-port", str(self.port)])
        try:
            yield process
        finally:
            process.kill()
            process.wait()

    def close(self) -> None:
        self.engine.close()
        self.session.close()


def test_a_server_that_is_killed_stopped_restarted_or_doubled(
    checkpoint: Path, tmp_path: Path
) -> None:
    runtime, description = load_runtime(PolicyConfig(checkpoint=checkpoint))
    other = saved(tmp_path / "other", STEREO, seed=1)
    player = Player(description)
    expected = [runtime.run(*request(step)[1:]) for step in range(11)]

    def right(answers: list[Answer]) -> list[int]:
        for answer in answers:
            for got, wanted in zip(answer.decision, expected[answer.step][0], strict=True):
                np.testing.assert_allclose(got, wanted, atol=1e-5)
            np.testing.assert_allclose(answer.memory, expected[answer.step][1], atol=1e-5)
        return [answer.step for answer in answers]

    def check(answers: list[Answer], step: int, count: int = 1) -> None:
        assert right(answers) == [step] * count

    try:
        player.engine.ask(request(0))
        assert player.drain() == []
        assert player.engine.problem == NO_SERVER
        with player.server(checkpoint) as process:
            check(player.ask(0), 0)
            assert player.engine.problem == ""
            # Stopped, it leaves requests waiting; afterwards it answers the newest, and of the
            # others at most those that it had taken before the newest was read.
            os.kill(process.pid, signal.SIGSTOP)
            for step in range(1, 11):
                player.engine.ask(request(step))
                time.sleep(0.03)
            assert player.engine.answers() == []
            os.kill(process.pid, signal.SIGCONT)
            steps = right(player.drain())
            assert steps == sorted(set(steps))
            assert steps[-1] == 10
            assert len(steps) < 10
            process.kill()
            player.engine.ask(request(4))
            assert player.drain() == []
        with player.server(checkpoint), player.server(checkpoint):
            check(player.ask(5, answers=2), 5, count=2)
        assert player.engine.refused == 0
        # One of another checkpoint says so, and disturbs nobody.
        with player.server(other), player.server(checkpoint):
            check(player.ask(5), 5)
            while not player.engine.refused:
                check(player.ask(5), 5)
            assert "expected the checkpoint" in player.engine.problem or not player.engine.problem
    finally:
        player.close()
