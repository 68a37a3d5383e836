"""The conditions that are compared: which links are late, and whether hands are interpolated."""

import re
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from common.errors import ConfigError, explain
from common.links.config import Links
from common.links.spec import LinkSpec
from common.links.summary import requested

RAW, BASELINE = "raw", "interpolation"
DIRECTIONS = ("command", "feedback", "both")
COMMAND_INPUT = ("wbc", "teleop/setpoint")
"""Consumer and topic by which the way from operator to robot is judged."""
FEEDBACK_INPUT = ("teleop", "plant/state")
"""The same for the way back."""
_OUTSIDE_PARENTHESES = re.compile(r",(?![^(]*\))")
_NAME = r"^[a-z0-9][a-z0-9._-]*$"


class Condition(BaseModel):
    """One way to set the system up.

    Attributes:
        name: short, lower case.
        label: for figures; empty: the name.
        links: injected delays by name; no others, not even a task's own.
        raw_hands: hand set-points go to the controller as they come, without interpolation.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=_NAME, max_length=40)
    label: str = Field(default="", max_length=40)
    links: dict[str, str] = Field(default_factory=dict)
    raw_hands: bool = False

    @field_validator("links")
    @classmethod
    def _known(cls, links: dict[str, str]) -> dict[str, str]:
        try:
            Links.from_table(links)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return dict(sorted(links.items()))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``NAME=command=100ms,feedback=50ms,raw``; ``NAME=none`` has no delay.

        Raises:
            ConfigError: it is no such text, or a link in it is wrong.
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
            return cls.model_validate(values)
        except ValidationError as error:
            raise ConfigError(f"condition {text!r}: {explain(error)}") from error

    @property
    def title(self) -> str:
        """For figures."""
        return self.label or self.name

    def asked(self, consumer: str, topic: str) -> tuple[float, float]:
        """Mean and 99th percentile of the delay asked for on one link [s]."""
        asked = requested(Links.from_table(self.links).of(consumer, topic) or LinkSpec())
        return asked.mean, asked.p99

    @property
    def delay(self) -> float:
        """Mean delay asked for, there and back [s]."""
        return self.asked(*COMMAND_INPUT)[0] + self.asked(*FEEDBACK_INPUT)[0]


_EXPECTED = (
    "expected the name of a standard condition, or NAME=LINK=SPEC,... with links such as "
    "command=100ms, feedback=50ms or both=1s, 'raw' for no interpolation, or NAME=none"
)


def standard(direction: str) -> tuple[Condition, ...]:
    """The paper's four: raw input, the final set-up, and this with 250 and 500 ms more.

    Args:
        direction: which way is late: ``command``, ``feedback`` or ``both``.

    Raises:
        ConfigError: it is none of these.
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


def chosen(options: list[str], direction: str) -> tuple[Condition, ...]:
    """The conditions of the options; without any the standard ones.

    Args:
        options: each the name of a standard one, or as :meth:`Condition.parse` reads it.
        direction: of the standard ones.

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
