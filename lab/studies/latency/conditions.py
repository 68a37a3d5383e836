"""Conditions of the study: injected delays, and whether hand set-points are interpolated."""

import re
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from common.errors import ConfigError
from common.links.config import Links
from common.links.spec import LinkSpec
from common.links.summary import requested
from lab.trials.spec import LinkTable, validated

RAW, BASELINE = "raw", "interpolation"
DIRECTIONS = ("command", "feedback", "both")
COMMAND_INPUT = ("wbc", "teleop/setpoint")
"""The input, as consumer and topic, at which latency from operator to robot is measured."""
FEEDBACK_INPUT = ("teleop", "plant/state")
"""The input at which the synthetic operator's latency from the robot is measured."""
_OUTSIDE_PARENTHESES = re.compile(r",(?![^(]*\))")
_NAME = r"^[a-z0-9][a-z0-9._-]*$"


class Condition(BaseModel):
    """One experimental condition.

    Attributes:
        name: short name in lower case.
        label: title in tables and figures; empty: the name.
        links: injected delays by name; there are no others, not even a task's own.
        raw_hands: whether the controller uses hand set-points without interpolation.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=_NAME, max_length=40)
    label: str = Field(default="", max_length=40)
    links: LinkTable = Field(default_factory=dict)
    raw_hands: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse ``NAME=command=100ms,feedback=50ms,raw``; ``NAME=none`` has no delay.

        Raises:
            ConfigError: the text is not understood, or a link in it is wrong.
        """
        name, equals, rest = text.partition("=")
        if not equals:
            raise ConfigError(f"condition {text!r}: {_EXPECTED}")
        values: dict[str, Any] = {"name": name.strip(), "links": {}}
        for part in _OUTSIDE_PARENTHESES.split(rest):
            link, separator, spec = part.partition("=")
            if separator:
                values["links"][link.strip()] = spec.strip()
            elif part.strip() == RAW:
                values["raw_hands"] = True
            elif part.strip() != "none":
                raise ConfigError(f"condition {text!r}: {part.strip()!r} is unknown; {_EXPECTED}")
        try:
            return validated(cls, values)
        except ConfigError as error:
            raise ConfigError(f"condition {text!r}: {error}") from error

    @property
    def title(self) -> str:
        """Title in tables and figures."""
        return self.label or self.name

    @property
    def text(self) -> str:
        """The settings in the form that :meth:`parse` reads after the name."""
        links = [f"{name}={spec}" for name, spec in self.links.items()]
        return ",".join([*links, *([RAW] if self.raw_hands else [])]) or "none"

    def asked(self, consumer: str, topic: str) -> tuple[float, float]:
        """Return mean and 99th percentile of the delay requested for one input [s]."""
        asked = requested(Links.from_table(self.links).of(consumer, topic) or LinkSpec())
        return asked.mean, asked.p99

    @property
    def delay(self) -> float:
        """Mean requested delay, command and feedback together [s]."""
        return self.asked(*COMMAND_INPUT)[0] + self.asked(*FEEDBACK_INPUT)[0]


_EXPECTED = (
    "expected the name of a standard condition, or NAME=LINK=SPEC,... with links such as "
    "command=100ms, feedback=50ms or both=1s, 'raw' for no interpolation, or NAME=none"
)


def standard(direction: str) -> tuple[Condition, ...]:
    """Return the paper's four conditions.

    They are raw input, interpolation (the final set-up), and this with 250 and 500 ms of delay.

    Args:
        direction: which direction is delayed: ``command``, ``feedback`` or ``both``.

    Raises:
        ConfigError: ``direction`` is none of these.
    """
    if direction not in DIRECTIONS:
        raise ConfigError(f"expected --direction {', '.join(DIRECTIONS)}, got {direction!r}")
    late = (
        Condition(name=f"latency-{ms}", label=f"+{ms} ms", links={direction: f"{ms}ms"})
        for ms in (250, 500)
    )
    return (
        Condition(name=RAW, label="raw input", raw_hands=True),
        Condition(name=BASELINE),
        *late,
    )


def chosen_conditions(options: list[str], direction: str) -> tuple[Condition, ...]:
    """Return the conditions that were asked for; without options the standard ones.

    Args:
        options: each the name of a standard condition, or a text for :meth:`Condition.parse`.
        direction: delayed direction of the standard conditions.

    Raises:
        ConfigError: an option is wrong, or two conditions have the same name.
    """
    known = {condition.name: condition for condition in standard(direction)}
    if not options:
        return tuple(known.values())
    conditions = tuple(known.get(text.strip()) or Condition.parse(text) for text in options)
    names = [condition.name for condition in conditions]
    if len(set(names)) != len(names):
        raise ConfigError(f"expected conditions of different names, got {', '.join(names)}")
    return conditions
