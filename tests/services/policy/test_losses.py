"""Losses: against torch.distributions, their theoretical floors, and their gradients."""

from math import e, log, pi
from typing import Any

import pytest

from services.policy.configuration import ChunkConfig, LossConfig, MixtureConfig
from services.policy.kinds import network
from tests.services.policy.made import small

torch = pytest.importorskip("torch", reason="needs the extra policy")
from torch import distributions as d  # noqa: E402

from services.policy.networks.continuous import (  # noqa: E402
    MixtureOutput,
    RegressionOutput,
    mixture_log_likelihood,
)
from services.policy.networks.policy import Mean, TargetBatch  # noqa: E402


def mixture(*shape: int, modes: int = 5, numbers: int = 14) -> dict[str, Any]:
    generator = torch.Generator().manual_seed(0)
    draw = {"generator": generator, "dtype": torch.float64}
    return {
        "mode": torch.randn(*shape, modes, **draw),
        "mean": torch.randn(*shape, modes, numbers, **draw),
        "std": 0.03 + torch.rand(*shape, modes, numbers, **draw),
    }


def targets(frames: int = 8, steps: int = 1, numbers: int = 14, **changes: Any) -> TargetBatch:
    torch.manual_seed(0)
    given = {
        "hands": torch.randn(2, frames, steps, numbers),
        "grasp": torch.randint(0, 2, (2, frames, steps, 2)).float(),
        "gait": torch.arange(2 * frames).view(2, frames) % 7,
        "gait_counts": torch.ones(2, frames, dtype=torch.bool),
        "valid": torch.ones(2, frames, dtype=torch.bool),
    }
    return TargetBatch(**(given | changes))


def test_the_log_likelihood_of_a_mixture_is_that_of_torch_distributions() -> None:
    outputs = mixture(3, 7)
    value = torch.randn(3, 7, 14, dtype=torch.float64)
    expected = d.MixtureSameFamily(
        d.Categorical(logits=outputs["mode"]),
        d.Independent(d.Normal(outputs["mean"], outputs["std"]), 1),
    ).log_prob(value)
    torch.testing.assert_close(mixture_log_likelihood(outputs, value), expected, rtol=1e-12, atol=0)


def test_the_gradient_of_the_mixture_is_that_of_finite_differences() -> None:
    outputs = mixture(2, modes=3, numbers=4)
    value = torch.randn(2, 4, dtype=torch.float64)
    leaves = [leaf.requires_grad_() for leaf in outputs.values()]
    assert torch.autograd.gradcheck(
        lambda *p: mixture_log_likelihood(dict(zip(outputs, p, strict=True)), value), leaves
    )


def test_a_far_value_has_a_finite_likelihood_and_gradient() -> None:
    outputs = {name: leaf.float().requires_grad_() for name, leaf in mixture(1).items()}
    loss = -mixture_log_likelihood(outputs, torch.full((1, 14), 1e4))
    loss.sum().backward()
    assert bool(torch.isfinite(loss).all())
    assert all(bool(torch.isfinite(leaf.grad).all()) for leaf in outputs.values())


def fitted(output: MixtureOutput, value: Any) -> float:
    """Return the mean loss of an output, trained on values that have nothing to go by."""
    features = torch.ones(len(value), 1)
    optimiser = torch.optim.Adam(output.parameters(), lr=0.05)
    for step in range(150):
        optimiser.param_groups[0]["lr"] = 0.05 * (1.0 - step / 150)
        optimiser.zero_grad()
        output.loss(output(features), value).mean().backward()
        optimiser.step()
    with torch.no_grad():
        return float(output.loss(output(features), value).mean())


def test_the_floor_of_the_mixture_is_the_entropy_of_the_data() -> None:
    torch.manual_seed(0)
    value = torch.tensor([0.5, 1.0, 2.0]) * torch.randn(300, 3)
    # A Gaussian fitted to the sample has the entropy of its own standard deviations.
    floor = float((value.std(0, unbiased=False) * (2.0 * pi * e) ** 0.5).log().sum())
    output = MixtureOutput(1, 3, MixtureConfig(modes=1))
    assert fitted(output, value) == pytest.approx(floor, abs=0.01)


def test_the_floor_of_two_clusters_is_the_choice_between_them_and_the_entropy_of_one() -> None:
    torch.manual_seed(0)
    around = 0.2 * torch.randn(200, 1)
    around -= around.mean()
    value = torch.cat((around + 2.0, around - 2.0))
    std = float(around.std(0, unbiased=False))
    outputs = {
        "mode": torch.zeros(400, 2),
        "mean": torch.tensor([[2.0], [-2.0]]).expand(400, 2, 1),
        "std": torch.full((400, 2, 1), std),
    }
    loss = -mixture_log_likelihood(outputs, value).mean()
    assert float(loss) == pytest.approx(log(2.0) + log(std) + 0.5 * log(2.0 * pi * e), abs=1e-5)


def test_the_floor_of_a_sure_thing_is_that_of_the_least_standard_deviation() -> None:
    output = MixtureOutput(1, 2, MixtureConfig(modes=1, minimum_std=0.03))
    with torch.no_grad():
        output.std.bias.fill_(-50.0)
        outputs = output(torch.zeros(4, 1))
        loss = output.loss(outputs, outputs["mean"].squeeze(-2))
    torch.testing.assert_close(loss, torch.full((4,), 2.0 * (log(0.03) + 0.5 * log(2.0 * pi))))


def test_the_mean_of_the_likeliest_mode_is_decided() -> None:
    outputs = mixture(2, 3)
    decided = MixtureOutput(1, 14, MixtureConfig()).decide(outputs)
    index = outputs["mode"].argmax(-1)
    torch.testing.assert_close(decided[1, 2], outputs["mean"][1, 2, index[1, 2]])


def test_the_deterministic_loss_is_half_the_squared_error() -> None:
    output = RegressionOutput(1, 2)
    loss = output.loss({"mean": torch.tensor([[1.0, 2.0]])}, torch.tensor([[0.0, 4.0]]))
    assert float(loss) == pytest.approx(2.5)


def sure(gait: Any, grasp: Any) -> dict[str, Any]:
    """Return outputs of TRILL that are sure of these targets."""
    return {
        "grasp": 40.0 * (2.0 * grasp - 1.0),
        "trigger": torch.where(gait > 0, 40.0, -40.0),
        "gait": 40.0 * torch.nn.functional.one_hot((gait - 1).clamp(min=0), 6).float(),
        **{name: leaf.float() for name, leaf in mixture(2, 8).items()},
    }


def test_the_terms_of_trill_reach_zero_and_guessing_costs_the_entropy() -> None:
    policy = network(small("trill"))
    wanted = targets()
    terms = policy.terms(sure(wanted.gait, wanted.grasp), wanted)
    for name in ("grasp", "trigger", "gait"):
        assert float(terms[name].value) == pytest.approx(0.0, abs=1e-6)
    guessed = {
        name: torch.zeros_like(leaf) for name, leaf in sure(wanted.gait, wanted.grasp).items()
    } | {"std": torch.ones(2, 8, 5, 14)}
    terms = policy.terms(guessed, wanted)
    assert float(terms["grasp"].value) == pytest.approx(log(2.0))
    assert float(terms["trigger"].value) == pytest.approx(log(2.0))
    assert float(terms["gait"].value) == pytest.approx(log(6.0))


def test_the_type_of_gait_is_learned_where_one_is_asked_for() -> None:
    policy = network(small("trill"))
    gait = torch.zeros(2, 8, dtype=torch.long)
    gait[0, 3] = 4
    counts = torch.ones(2, 8, dtype=torch.bool)
    counts[1] = False
    wanted = targets(gait=gait, gait_counts=counts)
    outputs = sure(gait, wanted.grasp)
    outputs["gait"] = torch.zeros(2, 8, 6)
    outputs["gait"][0, 3, 3] = log(5.0)
    outputs["trigger"][1] = 40.0
    terms = policy.terms(outputs, wanted)
    assert float(terms["gait"].value) == pytest.approx(log(2.0))
    assert float(terms["trigger"].value) == pytest.approx(0.0, abs=1e-6)
    outputs["trigger"][0, 0] = 8.0
    assert float(policy.terms(outputs, wanted)["trigger"].value) == pytest.approx(1.0, abs=1e-3)


def test_frames_after_the_end_of_a_sequence_change_nothing() -> None:
    for kind in ("trill", "bc-rnn", "bc"):
        policy = network(small(kind))
        valid = torch.ones(2, 8, dtype=torch.bool)
        valid[1, 5:] = False
        wanted = targets(valid=valid)
        spoiled = wanted._replace(hands=wanted.hands.masked_fill(~valid[..., None, None], 1e3))
        outputs = policy.outputs(torch.randn(2, 8, 32))
        expected, got = (policy.terms(outputs, given) for given in (wanted, spoiled))
        assert got.keys() == expected.keys()
        for name, term in got.items():
            torch.testing.assert_close(term.value, expected[name].value)


def test_a_chunk_weighs_as_much_as_one_set_point() -> None:
    single = network(small("trill", deterministic=True))
    chunk = network(small("trill", deterministic=True, actions=ChunkConfig(steps=6)))
    ones, zeros = torch.ones(2, 8, 6, 13), torch.zeros(2, 8, 78)
    outputs = sure(targets().gait, torch.zeros(2, 8, 6, 2)) | {"mean": zeros}
    assert (
        float(chunk.terms(outputs, targets(steps=6, numbers=13, hands=ones))["hands"].value) == 6.5
    )
    outputs = sure(targets().gait, torch.zeros(2, 8, 1, 2)) | {"mean": torch.zeros(2, 8, 14)}
    assert (
        float(single.terms(outputs, targets(hands=torch.ones(2, 8, 1, 14)))["hands"].value) == 7.0
    )


def test_the_terms_are_weighted_as_configured() -> None:
    policy = network(small("trill", loss=LossConfig(hands=1.0, grasp=2.0, trigger=0.0, gait=0.5)))
    terms = {
        name: Mean(torch.tensor(8.0), torch.tensor(2.0))
        for name in ("hands", "grasp", "trigger", "gait")
    }
    assert float(policy.loss(terms)) == 14.0


def test_the_categorical_ablation_has_no_trigger_and_chooses_none_too() -> None:
    policy = network(small("trill", categorical=True))
    wanted = targets()
    outputs = policy.outputs(torch.randn(2, 8, 32))
    outputs["gait"] = torch.zeros(2, 8, 7)
    terms = policy.terms(outputs, wanted)
    assert set(terms) == {"hands", "grasp", "gait"}
    assert float(terms["gait"].value) == pytest.approx(log(7.0))
    torch.testing.assert_close(policy.decide(outputs).gait, torch.full((2, 8, 7), 1.0 / 7.0))


def test_the_probability_of_a_gait_is_that_of_trigger_and_type() -> None:
    policy = network(small("trill"))
    outputs = policy.outputs(torch.randn(1, 1, 32))
    outputs["trigger"] = torch.tensor([[log(0.25 / 0.75)]])
    outputs["gait"] = torch.tensor([[[log(5.0), 0.0, 0.0, 0.0, 0.0, 0.0]]])
    gait = policy.decide(outputs).gait[0, 0]
    torch.testing.assert_close(gait[:3], torch.tensor([0.75, 0.125, 0.025]))


def test_a_flat_vector_means_what_it_was_trained_to_be() -> None:
    policy = network(small("bc"))
    wanted = targets()
    outputs = policy.outputs(torch.randn(2, 8, 32))
    vector = torch.cat(
        (
            wanted.hands.flatten(-2),
            2.0 * wanted.grasp.flatten(-2) - 1.0,
            (wanted.gait[..., None] / 3.0 - 1.0),
        ),
        dim=-1,
    )
    outputs["mean"] = vector
    assert float(policy.terms(outputs, wanted)["hands"].value) == pytest.approx(0.0, abs=1e-10)
    decision = policy.decide(outputs)
    torch.testing.assert_close(decision.hands, wanted.hands)
    torch.testing.assert_close(decision.grasp, wanted.grasp)
    torch.testing.assert_close(decision.gait.argmax(-1), wanted.gait)


def test_a_flat_mixture_asks_for_a_gait_as_often_as_vectors_drawn_from_it_would() -> None:
    torch.manual_seed(0)
    policy = network(small("bc-rnn"))
    outputs = policy.outputs(torch.randn(1, 1, 32))
    # Nothing, side left with some doubt, and turn right.
    outputs["mode"] = torch.tensor([0.7, 0.2, 0.1, 1e-9, 1e-9]).log().view(1, 1, -1)
    outputs["mean"][..., -1] = torch.tensor([-1.0, 3.0 / 3.0 - 1.0, 1.0, 0.0, 0.0])
    outputs["std"][..., -1] = torch.tensor([0.05, 0.2, 0.05, 1.0, 1.0])
    modes = torch.multinomial(outputs["mode"][0, 0].exp(), 100_000, replacement=True)
    mean, std = (outputs[name][0, 0, modes, -1] for name in ("mean", "std"))
    drawn = (3.0 * (torch.normal(mean, std) + 1.0)).round().long().clamp(0, 6)
    wanted = torch.bincount(drawn, minlength=7) / len(drawn)
    torch.testing.assert_close(policy.decide(outputs).gait[0, 0], wanted, atol=0.005, rtol=0.0)
