"""Builds the synthetic operator of a trial."""

from lab.trials.operators.kinds import OperatorServices
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.spec import TrialSpec
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator


def build(spec: TrialSpec) -> OperatorServices:
    """Return the synthetic operator; its variation is that of the trial's seed."""
    assert isinstance(spec.operator, SyntheticSpec)
    operator = SyntheticOperator(
        SyntheticConfig(task=spec.task, seed=spec.seed, traits=spec.operator.traits, stay=True)
    )
    return OperatorServices(operator, (operator,))
