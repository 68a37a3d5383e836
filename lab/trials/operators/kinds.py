"""THE table of the kinds of operator: what builds each, and what its trials depend on."""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from common.runtime.service import Service
from lab.trials.operators.specs import OperatorSpec
from lab.trials.provenance import PHYSICS, CodeVersion, code_version

if TYPE_CHECKING:
    from lab.trials.spec import TrialSpec


class TaskOperator(Protocol):
    """What a trial reports of its operator."""

    @property
    def failure(self) -> str:
        """Why the operator gave up; empty: it did not."""

    @property
    def note(self) -> str:
        """What the operator is doing."""


class OperatorServices(NamedTuple):
    """An operator of one trial.

    Attributes:
        operator: tells how it goes.
        services: its services, and those that only it needs, in the order of their steps.
    """

    operator: TaskOperator
    services: tuple[Service, ...]


class _Kind(NamedTuple):
    """A row of the table.

    Attributes:
        module: has ``build(spec) -> OperatorServices``; it is imported only to build the operator.
        also: modules that decide what the operator does and that no import statement names.
        packages: packages that do, besides those of the robot.
    """

    module: str
    also: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()


# The networks are chosen by name.
_NETWORKS: Final = ("services.policy.*",)
_LEARNING: Final = ("torch", "safetensors", "opencv-python-headless")
_KINDS: Final[dict[str, _Kind]] = {
    "synthetic": _Kind("lab.trials.operators.synthetic"),
    "policy": _Kind("lab.trials.operators.policy", _NETWORKS, _LEARNING),
    "helped": _Kind("lab.trials.operators.helped", _NETWORKS, _LEARNING),
}


def build_operator(spec: "TrialSpec") -> OperatorServices:
    """Build the operator of a trial.

    Raises:
        TrillError: it cannot be built.
    """
    build: Callable[[TrialSpec], OperatorServices] = import_module(
        _KINDS[spec.operator.kind].module
    ).build
    return build(spec)


def operator_code(
    operator: OperatorSpec, *roots: str, packages: tuple[str, ...] = PHYSICS
) -> CodeVersion:
    """Return the version of the code that runs trials of an operator.

    Code of other kinds of operator does not count, so that results outlast its changes.

    Args:
        operator: of the trials.
        roots: modules that import all other code that has a part in the trials.
        packages: as for :func:`~lab.trials.provenance.code_version`.
    """
    kind = _KINDS[operator.kind]
    return code_version(*roots, kind.module, *kind.also, packages=(*packages, *kind.packages))
