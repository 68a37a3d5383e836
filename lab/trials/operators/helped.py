"""Builds a policy, and the synthetic operator that takes over when the policy does not get on."""

from lab.trials.operators import policy
from lab.trials.operators.kinds import OperatorServices
from lab.trials.operators.specs import HelpedSpec
from lab.trials.spec import TrialSpec
from services.policy.service import PolicyOperator
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator


class HelpedOperator:
    """Reports what whoever has the robot is doing."""

    def __init__(self, policy: PolicyOperator, helper: SyntheticOperator) -> None:
        self._policy, self._helper = policy, helper

    @property
    def failure(self) -> str:
        """Why the helper gave up; empty: it did not, or was not needed."""
        return self._helper.failure

    @property
    def note(self) -> str:
        """What the helper is doing once it has taken over, and the policy before."""
        operator = self._policy if self._helper.model is None else self._helper
        return f"{operator.name}: {operator.note}"


def build(spec: TrialSpec) -> OperatorServices:
    """Return both operators, and the camera service if the policy sees.

    Raises:
        TrillError: as :func:`lab.trials.operators.policy.build` does.
    """
    helped = spec.operator
    assert isinstance(helped, HelpedSpec)
    first, services = policy.build(spec.model_copy(update={"operator": helped.policy}))
    assert isinstance(first, PolicyOperator)
    helper = SyntheticOperator(
        SyntheticConfig(
            task=spec.task,
            seed=spec.seed,
            traits=helped.traits,
            take_over=helped.take_over,
            stay=True,
        )
    )
    return OperatorServices(HelpedOperator(first, helper), (*services, helper))
