"""The success rates that the paper reports, to be shown beside those measured here."""

from typing import Final, NamedTuple

SOURCE = (
    'Seo et al., "Deep Imitation Learning for Humanoid Loco-manipulation through Human '
    'Teleoperation", Humanoids 2023: comparison with baselines, and ablation studies; 25 trials '
    "each, of policies trained on demonstrations of persons"
)


class Rates(NamedTuple):
    """Success rates of one policy in one task.

    Attributes:
        success: full success [%].
        partial: full or partial success [%].
    """

    success: int
    partial: int


PAPER_TASKS: Final = (
    "door/walk", "door/unlock", "door/push", "bench/walk", "bench/hammer", "bench/push",
)  # fmt: skip
_RATES: Final = {
    "bc": ((0, 0), (48, 52), (0, 0), (0, 0), (0, 16), (0, 0)),
    "bc-rnn": ((40, 80), (80, 96), (56, 64), (52, 88), (60, 80), (80, 88)),
    "trill": ((100, 100), (92, 100), (96, 96), (92, 96), (68, 76), (88, 88)),
    "trill, monoscopic": ((100, 100), (56, 84), (16, 32), (100, 100), (28, 48), (24, 44)),
    "trill, no-joint-state": ((92, 96), (64, 84), (24, 64), (88, 100), (12, 20), (52, 60)),
    "trill, deterministic": ((92, 100), (40, 72), (24, 28), (36, 80), (0, 0), (4, 4)),
    "trill, categorical": ((52, 84), (92, 96), (80, 80), (92, 96), (36, 64), (32, 40)),
}
PAPER: Final[dict[str, dict[str, Rates]]] = {
    name: {task: Rates(*pair) for task, pair in zip(PAPER_TASKS, rates, strict=True)}
    for name, rates in _RATES.items()
}
"""Rates by name of the policy, as :func:`~lab.learning.evaluation.names.policy_name` has it."""
