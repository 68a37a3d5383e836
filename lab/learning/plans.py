"""Plans of a study: which policies are trained and evaluated, in options of the two commands."""

from collections.abc import Iterable, Sequence
from typing import Final, Literal, NamedTuple, get_args

from lab.learning.training.recipes import RecipeName

Plan = Literal["kinds", "ablations", "sizes"]
"""``kinds`` of policy beside one another, the paper's ``ablations``, ``sizes`` of the data set."""
PLANS: Final[tuple[Plan, ...]] = get_args(Plan)
SIZES: Final = (25, 50, 100, 250)
"""Sizes of the data set that are compared, as far as it has so many demonstrations."""


class Step(NamedTuple):
    """A policy to be trained and evaluated.

    Attributes:
        variant: what sets it apart, for the name of its folder; empty: its options do.
        train: options of ``trill train``.
        evaluate: options of ``trill eval``.
    """

    variant: str = ""
    train: tuple[str, ...] = ()
    evaluate: tuple[str, ...] = ()


_KINDS: Final = (
    Step(evaluate=("--constant",)),
    Step(train=("--policy", "bc-rnn")),
    Step(train=("--policy", "bc")),
    Step(train=("--inputs", "blind")),
)
_UNFELT: Final[dict[RecipeName, tuple[str, ...]]] = {
    "paper": ("joint_state",),
    # It never observes the joints themselves, so that all goes that is computed from them.
    "chunks": ("body_poses", "gripper_closure"),
}
"""Inputs that a policy without joint state has not."""


def steps(plans: Iterable[Plan], sizes: Sequence[int], recipe: RecipeName) -> list[Step]:
    """Return what is trained and evaluated for a task, each once.

    Args:
        plans: what is compared.
        sizes: numbers of demonstrations, for ``sizes``.
        recipe: of all trainings.
    """
    found: list[Step] = []
    for plan in plans:
        if plan == "kinds":
            found += _KINDS
        elif plan == "ablations":
            found += [_KINDS[0], *_ablations(recipe)]
        else:
            found += [Step(train=("--episodes", str(size))) for size in sizes]
    return list(dict.fromkeys(found))


def _ablations(recipe: RecipeName) -> list[Step]:
    """Return the paper's ablations by its names."""
    settings = {
        "monoscopic": ("policy.inputs.vision=monoscopic",),
        "no-joint-state": tuple(f"policy.inputs.{name}=false" for name in _UNFELT[recipe]),
        "deterministic": ("policy.deterministic=true",),
        "categorical": ("policy.categorical=true",),
    }
    return [
        Step(name, tuple(word for change in changes for word in ("--set", change)))
        for name, changes in settings.items()
    ]
