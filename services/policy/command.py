"""The command ``python -m services.policy``: a policy as an operator of the robot."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from common.runtime.live.components import Component
from common.runtime.live.main import OptionFormatter, run_live
from common.runtime.service import Service
from common.tables import validated
from services.policy.checkpoint.manifest import describe
from services.policy.options import add_inference_options
from services.policy.service import PolicyConfig, PolicyOperator
from services.policy.serving.remote import RemoteEngine

DESCRIPTION = """Operate the robot by a policy: 20 times a second it looks at pictures and
measurements and sends set-points of hands and grippers, and now and then a request for a gait. It
takes a robot that nobody has. A person who takes the robot interrupts it; it goes on, from where
the robot is then, when it is given back. Without pictures or answers the hands hold and the robot
keeps its balance."""
EXAMPLES = """examples:
  python -m services.policy runs/unlock/best                 beside `trill up --task door/unlock`
  python -m services.policy runs/unlock/best --runtime onnx  without torch; see trill export-policy
  python -m services.policy runs/unlock/best --remote        a server computes, without torch here:
  python -m services.policy.server runs/unlock/best --device cuda --mode client --host robot
"""
_OPTIONS = frozenset(PolicyConfig.model_fields)


class _Formatter(OptionFormatter, argparse.RawDescriptionHelpFormatter):
    """Help formatter that shows defaults and keeps the layout of the examples."""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add options without defaults, so that only given ones override the file's table."""
    parser.epilog, parser.formatter_class = EXAMPLES, _Formatter
    group = parser.add_argument_group("policy", argument_default=argparse.SUPPRESS)
    group.add_argument(
        "checkpoint",
        type=Path,
        nargs="?",
        default=None,
        help="folder that training wrote (default: the configuration's)",
    )
    group.add_argument("--kind", help="refuse a checkpoint of another kind of policy")
    add_inference_options(group)
    group.add_argument(
        "--execute", type=int, help="steps of a chunk carried out before the next one (5)"
    )
    group.add_argument(
        "--no-compensate",
        dest="compensate",
        action="store_false",
        help="do not skip the steps of a chunk that the measured delay takes",
    )
    group.add_argument(
        "--stay", action="store_true", help="wait for the robot without a timeout (60 s)"
    )


def build(arguments: argparse.Namespace) -> PolicyOperator:
    """Build the service: options override the file's ``[policy]`` table.

    Raises:
        ConfigError: an option is wrong, or the runtime is not installed.
        CheckpointError: the checkpoint cannot be served.
    """
    given = vars(arguments)
    options = {name: given[name] for name in _OPTIONS & given.keys() if given[name] is not None}
    config = validated(PolicyConfig, arguments.settings, options)
    if not config.remote:
        return PolicyOperator(config)
    description = describe(config.checkpoint, config.kind)
    return PolicyOperator(config, RemoteEngine(description, config.answer_timeout), description)


def _components(service: Service) -> Sequence[Component]:
    """Return the engine, if it needs the service's session."""
    assert isinstance(service, PolicyOperator)
    return (service.engine,) if isinstance(service.engine, RemoteEngine) else ()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the policy until a signal; returns the exit code."""
    return run_live(
        build,
        PolicyOperator.name,
        argv,
        add_arguments=_add_arguments,
        description=DESCRIPTION,
        # Inference must not keep the controller from its core.
        background=True,
        components=_components,
    )
