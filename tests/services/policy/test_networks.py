"""Networks: sequences and single steps agree, the sizes are the paper's, the flags work."""

from typing import Any

import numpy as np
import pytest

from services.policy.configuration import (
    ChunkConfig,
    ConvolutionConfig,
    InputConfig,
    PolicySettings,
    ResNetConfig,
)
from services.policy.kinds import CONFIGS, network
from services.policy.trill.configuration import GaitNetworkConfig
from tests.services.policy.made import SIZE, small

torch = pytest.importorskip("torch", reason="needs the extra policy")
from services.policy.networks.encoder import Encoder, SpatialSoftmax  # noqa: E402
from services.policy.networks.policy import PolicyNetwork  # noqa: E402
from services.policy.networks.resnet import ResNet18  # noqa: E402
from services.policy.runtimes.runtime import CachingRuntime, warm_up  # noqa: E402
from services.policy.runtimes.torch_backend import TorchBackend  # noqa: E402


def parameters(module: Any) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def made(config: PolicySettings) -> PolicyNetwork:
    torch.manual_seed(0)
    return network(config)


def inputs(config: PolicySettings, sequences: int = 1, frames: int = 6) -> tuple[Any, Any]:
    generator = torch.Generator().manual_seed(1)
    width, height = config.inputs.picture_size
    shape = (sequences, frames, len(config.inputs.cameras), height, width, 3)
    return (
        torch.randn(sequences, frames, config.inputs.width, generator=generator),
        torch.randint(0, 256, shape, generator=generator, dtype=torch.uint8),
    )


@pytest.mark.parametrize("kind", list(CONFIGS))
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"actions": ChunkConfig(steps=4), "deterministic": False},
        {"deterministic": True},
        {"inputs": InputConfig(vision="monoscopic", picture_size=SIZE, joint_state=False)},
        {"inputs": InputConfig(vision="blind", scene=("yaw",))},
        {"encoder": ResNetConfig(width=2, key_points=4, features=8)},
    ],
    ids=["plain", "chunks", "deterministic", "monoscopic, no joints", "oracle", "resnet"],
)
def test_a_sequence_and_its_single_steps_agree(kind: str, changes: dict[str, Any]) -> None:
    config = small(kind, **changes)
    policy = made(config)
    observation, pictures = inputs(config)
    policy.look(pictures)  # moves the statistics of the batch normalisation
    policy.eval()
    with torch.no_grad():
        outputs, memory = policy(observation, policy.look(pictures))
        whole = policy.decide(outputs)

    runtime = CachingRuntime(TorchBackend(policy))
    state = np.zeros(config.memory_shape, dtype=np.float32)
    for t in range(6):
        decision, state = runtime.run(
            observation[0, t : t + 1].numpy(), pictures[0, t : t + 1].numpy(), state
        )
        for got, expected in zip(decision, whole, strict=True):
            np.testing.assert_allclose(got, expected[0, t].numpy(), atol=2e-6)
    np.testing.assert_allclose(state, memory[:, :, 0].numpy(), atol=2e-6)
    assert decision.hands.shape == config.actions.shape
    assert decision.grasp.shape == (config.actions.shape[0], 2)
    np.testing.assert_allclose(decision.gait.sum(), 1.0, atol=1e-6)


def test_a_picture_in_many_windows_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    policy = made(small("trill")).eval()
    observation, pictures = inputs(policy.config, frames=80)
    zero = np.zeros(policy.config.memory_shape, dtype=np.float32)
    looked: list[int] = []

    def look(views: Any) -> Any:
        looked.append(views.shape[1])
        return PolicyNetwork.look(policy, views)

    runtime = CachingRuntime(TorchBackend(policy))
    monkeypatch.setattr(policy, "look", look)
    for end in (4, 9, 9, 80):
        window = slice(max(0, end - 8), end)
        decision, memory = runtime.run(
            observation[0, window].numpy(), pictures[0, window].numpy(), zero
        )
        with torch.no_grad():
            seen = PolicyNetwork.look(policy, pictures[:, window])
            outputs, after = policy(observation[:, window], seen)
            expected = policy.decide(outputs)
        np.testing.assert_allclose(decision.hands, expected[0][0, -1].numpy(), atol=2e-6)
        np.testing.assert_allclose(memory, after[:, :, 0].numpy(), atol=2e-6)
    assert looked == [4, 5, 8]


def test_a_warm_up_shows_as_many_new_pictures_as_service_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    policy = made(small("trill"))
    looked: list[int] = []

    def look(views: Any) -> Any:
        looked.append(views.shape[1])
        return PolicyNetwork.look(policy, views)

    monkeypatch.setattr(policy, "look", look)
    warm_up(CachingRuntime(TorchBackend(policy)), policy.config, 20, 5)
    assert looked == [1, 20, 5]


def test_what_a_recurrent_policy_saw_changes_what_it_does_and_a_reactive_one_forgets() -> None:
    for kind, remembers in (("trill", True), ("bc-rnn", True), ("bc", False)):
        config = small(kind)
        policy = made(config).eval()
        observation, pictures = inputs(config)
        other = observation.clone()
        other[:, 0] += 1.0
        with torch.no_grad():
            seen = policy.look(pictures)
            last = [policy(x, seen)[0]["mean"][:, -1] for x in (observation, other)]
        assert bool((last[0] == last[1]).all()) is not remembers


def test_gaits_with_a_network_of_their_own_are_decided_by_this_frame_alone() -> None:
    inputs_of = InputConfig(picture_size=SIZE, previous_setpoint=True, estimated=("ball.x",))
    config = small("trill", inputs=inputs_of, gait_network=GaitNetworkConfig(layers=(8,)))
    policy = made(config).eval()
    observation, _ = inputs(config)
    setpoint = list(config.inputs.parts).index("previous_setpoint")
    first = sum([*config.inputs.parts.values()][:setpoint])

    def decided(frame: int, column: int | None) -> tuple[Any, Any]:
        """Return hands and gait of the last frame after a change in one frame."""
        changed, seen = observation.clone(), torch.zeros(1, 6, 1)
        if column is None:
            seen[0, frame] = 3.0
        else:
            changed[0, frame, column] += 3.0
        with torch.no_grad():
            outputs, _ = policy(changed, seen, at=torch.tensor([5]))
            hands, _, gait = policy.decide(outputs)
            return hands, gait

    hands, gait = decided(5, len(observation[0, 0]) - 1)
    for frame, column, same in [
        (2, first, True),
        (5, 0, True),
        (5, first, False),
        (5, None, False),
    ]:
        other_hands, other_gait = decided(frame, column)
        assert torch.equal(gait, other_gait) is same, (frame, column)
        assert not torch.equal(hands, other_hands)


def test_the_outputs_of_chosen_frames_are_those_of_all_frames() -> None:
    policy = made(small("trill")).eval()
    observation, pictures = inputs(policy.config, sequences=2)
    at = torch.tensor([4, 1])
    with torch.no_grad():
        seen = policy.look(pictures)
        every, chosen = policy(observation, seen)[0], policy(observation, seen, at=at)[0]
    for name, output in chosen.items():
        torch.testing.assert_close(output, every[name][:, at])


def test_the_papers_network_has_its_size() -> None:
    policy = made(CONFIGS["trill"].profile("paper"))
    # The convolutions of two ResNet18, two LSTM layers of 400, two layers of 1024.
    assert parameters(policy.encoders["left"].trunk) == 11_176_512
    assert parameters(policy.lstm) == 4 * 400 * ((245 + 400 + 2) + (400 + 400 + 2))
    assert parameters(policy.mlp) == 401 * 1024 + 1025 * 1024
    assert policy.config.memory_shape == (2, 2, 400)
    assert 26.3e6 < parameters(policy) < 26.4e6


def test_the_parameters_of_resnet18_have_torchvisions_names() -> None:
    state = ResNet18().state_dict()
    # 20 convolutions and 20 normalisations of 5 tensors; the classifier is left out.
    assert len(state) == 120
    assert state["layer2.0.downsample.0.weight"].shape == (128, 64, 1, 1)
    assert state["layer4.1.bn2.running_var"].shape == (512,)
    assert not any(name.startswith("layer1.0.downsample") for name in state)
    assert ResNet18(16)(torch.zeros(1, 3, 64, 96)).shape == (1, 128, 2, 3)


def test_key_points_are_where_the_heat_is() -> None:
    layer = SpatialSoftmax(1, 1)
    with torch.no_grad():
        layer.project.weight.fill_(1.0)
    maps = torch.zeros(1, 1, 5, 9)
    maps[0, 0, 1, 6] = 50.0
    # Column 6 of 0..8 and row 1 of 0..4, on a scale from -1 to 1.
    torch.testing.assert_close(layer(maps), torch.tensor([[0.5, -0.5]]))
    torch.testing.assert_close(
        layer.heat(torch.randn(2, 1, 5, 9)).exp().sum((2, 3)), torch.ones(2, 1)
    )


def test_key_points_follow_what_is_seen_from_the_start() -> None:
    """With the usual initialisation they stay in the middle, and nothing is learned from them."""
    torch.manual_seed(0)
    encoder = Encoder(ConvolutionConfig(channels=(16, 32), strides=(2, 2)))
    pictures = torch.zeros(64, 36, 48, 3, dtype=torch.uint8)
    for i, picture in enumerate(pictures):
        picture[4 + i % 8 * 3 : 10 + i % 8 * 3, 4 + i // 8 * 4 : 12 + i // 8 * 4] = 255
    maps = encoder.trunk(pictures.permute(0, 3, 1, 2) / 255.0)
    spread = encoder.points(maps).std(0).mean()
    usual = SpatialSoftmax(32, 32)
    usual.project.reset_parameters()
    assert spread > 0.05
    assert spread > 3.0 * usual(maps).std(0).mean()


def test_the_pixels_are_colours_between_zero_and_one() -> None:
    encoder = Encoder(ConvolutionConfig(channels=(3,), strides=(1,))).eval()
    seen: list[Any] = []
    encoder.trunk.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    picture = torch.zeros(1, 8, 10, 3, dtype=torch.uint8)
    picture[0, 2, 7] = torch.tensor([255, 51, 0], dtype=torch.uint8)
    encoder(picture)
    assert seen[0].shape == (1, 3, 8, 10)
    torch.testing.assert_close(seen[0][0, :, 2, 7], torch.tensor([1.0, 0.2, 0.0]))
