"""Specification of a link's latency, jitter and loss, and its form as a string.

    250ms
    normal(122ms, 190ms) loss=1% seed=7
    lognormal(122ms, 190ms) corr=500ms
    constant(20ms) loss=0.5%
    trace(recorded_delays.csv) order=free
    loss=5%
    paper loss=1%

A trace file has one delay a line, with a unit (``12.5ms``) or in seconds. A name alone is one of
:data:`PRESETS`.
"""

import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from common.errors import ConfigError, explain

MAX_DELAY = 60.0
"""Longest delay accepted [s]."""
_MAX_SPREAD = 1e6
"""Largest standard deviation of log-normal delays, as a multiple of their mean: beyond it, draws
that never come make up the mean."""

PRESETS: Mapping[str, str] = {"paper": "lognormal(122ms, 190ms) corr=10s"}
"""Specifications with a name.

``paper`` is the real robot of the TRILL paper, which gives only mean and standard deviation of its
control latency, 122 ± 190 ms. Log-normal, because a normal distribution of that width puts a
quarter of the delays below 0, where they count as 0, and so has a mean of 152 ms. Correlated over
seconds, because the order of messages is kept: a delay can then fall no faster than time passes,
50 ms from one message to the next at 20 Hz, and from a tail that reaches a second it takes long to
come down. With 10 s the mean is raised by 3 % at 20 Hz and 4 % at 100 Hz; independent draws raise
it threefold. The price: in one minute the delay changes a few times only, so nine in ten means over
one minute lie between 40 and 285 ms. ``lognormal(122ms, 190ms) order=free`` has the mean in any
minute, but set-points that are overtaken are not applied.
"""

_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_DURATION = re.compile(r"([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?)\s*(ns|us|ms|s)?")
_HEADING = re.compile(r"[^0-9,;]+")
_SPEC = re.compile(
    r"(?:(?P<name>[a-z]+)\s*\((?P<inner>.*)\)"
    r"|(?P<plain>[0-9.][0-9.eE+-]*\s*(?:ns|us|ms|s)?(?!\S)|[^\s(=]+(?!\S)))?"
    r"(?P<rest>(?:\s*[a-z]+=\S+)*)\s*"
)
"""A delay, options, or both. A file name may hold parentheses: its last one ends it."""
_HELP = (
    "expected e.g. '250ms', 'normal(122ms, 190ms) loss=1% seed=7', 'lognormal(122ms, 190ms) "
    "corr=500ms', 'trace(delays.csv) order=free', 'paper'"
)

Delay = Annotated[float, Field(ge=0.0, le=MAX_DELAY)]


class Distribution(Enum):
    """How delays are drawn."""

    CONSTANT = "constant"
    NORMAL = "normal"
    LOGNORMAL = "lognormal"
    TRACE = "trace"


class LinkSpec(BaseModel):
    """Delay, jitter and loss of one link; see :mod:`common.links.delay` for the model.

    Also validates from a string, so a configuration file may hold either form.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    distribution: Distribution = Field(
        default=Distribution.CONSTANT, description="how delays are drawn"
    )
    mean: Delay = Field(default=0.0, description="[s]")
    sd: Delay = Field(default=0.0, description="standard deviation [s]")
    trace: tuple[Delay, ...] = Field(default=(), repr=False, description="recorded delays [s]")
    loss: float = Field(default=0.0, ge=0.0, le=1.0, description="probability")
    keep_order: bool = Field(default=True, description="no message overtakes another")
    correlation: Delay = Field(
        default=0.0, description="time constant of the jitter [s]; 0: independent draws"
    )
    seed: int | None = Field(default=None, ge=0, lt=2**63, description="None: the seed of the run")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the string form.

        Raises:
            ConfigError: the text is not a link specification, or its trace cannot be read.
        """
        try:
            return cls.model_validate(_values(text))
        except ValidationError as error:
            raise ConfigError(
                f"link specification {text!r} is wrong: {explain(error)}; {_HELP}"
            ) from error

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, value: object) -> object:
        return _values(value) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.distribution is Distribution.TRACE) != bool(self.trace):
            raise ValueError("a trace needs recorded delays, and nothing else takes them")
        if self.distribution is Distribution.LOGNORMAL and self.mean <= 0.0:
            raise ValueError("a log-normal delay needs a mean above 0")
        if self.distribution is Distribution.LOGNORMAL and self.sd > _MAX_SPREAD * self.mean:
            raise ValueError(
                f"a log-normal delay's standard deviation must be at most {_MAX_SPREAD:g} times "
                "its mean"
            )
        jitter = self.distribution in {Distribution.NORMAL, Distribution.LOGNORMAL}
        if self.sd > 0.0 and not jitter:
            raise ValueError("a standard deviation needs a normal or log-normal delay")
        if self.correlation > 0.0 and not jitter:
            raise ValueError("a correlation time needs a normal or log-normal delay")
        return self

    def __str__(self) -> str:
        if self.distribution is Distribution.CONSTANT:
            text = _duration(self.mean)
        elif self.distribution is Distribution.TRACE:
            text = f"trace({len(self.trace)} delays)"
        else:
            text = f"{self.distribution.value}({_duration(self.mean)}, {_duration(self.sd)})"
        if self.loss:
            text += f" loss={100.0 * self.loss:g}%"
        if self.correlation:
            text += f" corr={_duration(self.correlation)}"
        if not self.keep_order:
            text += " order=free"
        return text if self.seed is None else f"{text} seed={self.seed}"


def parse_duration(text: str) -> float:
    """Return a duration such as ``250ms``, ``0.3s``, ``500us`` or ``0`` in seconds.

    Raises:
        ConfigError: not a duration; only 0 may stand without a unit.
    """
    match = _DURATION.fullmatch(text.strip())
    if match is None or (match[2] is None and float(match[1]) != 0.0):
        raise ConfigError(f"{text!r} is not a duration; expected a number with ns, us, ms or s")
    return float(match[1]) * _UNITS[match[2] or "s"]


def read_trace(path: Path) -> tuple[float, ...]:
    """Read recorded delays [s], one a line, as spreadsheets and scripts write them.

    Blank lines, lines starting with #, a byte order mark and a heading in the first line are
    skipped.

    Raises:
        ConfigError: the file cannot be read, is empty, or a line is not a duration.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the delay trace {path}: {error}") from error
    delays = []
    for number, line in enumerate(lines, start=1):
        entry = line.strip().rstrip(",")
        if not entry or entry.startswith("#"):
            continue
        match = _DURATION.fullmatch(entry)
        if match is None and number == 1 and _HEADING.fullmatch(entry):
            continue
        if match is None:
            raise ConfigError(f"{path} line {number}: expected one delay a line, got {entry!r}")
        delays.append(float(match[1]) * _UNITS[match[2] or "s"])
    if not delays:
        raise ConfigError(f"the delay trace {path} holds no delay")
    return tuple(delays)


def _values(text: str) -> dict[str, Any]:
    """Parse the string form into fields."""
    match = _SPEC.fullmatch(text.strip())
    if match is None or not match[0]:
        raise ConfigError(f"link specification {text!r} not understood; {_HELP}")
    plain = match["plain"]
    values: dict[str, Any] = {}
    if plain in PRESETS:
        values = _values(PRESETS[plain])
    elif plain is not None:
        values = {"mean": parse_duration(plain)}
    elif match["name"] is not None:
        values = _distribution(match["name"], match["inner"], text)
    for option in match["rest"].split():
        values |= _option(option, text)
    return values


def _distribution(name: str, inner: str, text: str) -> dict[str, Any]:
    """Parse ``name(inner)``."""
    if name == Distribution.TRACE.value:
        return {"distribution": Distribution.TRACE, "trace": read_trace(Path(inner.strip()))}
    parts = [part for part in inner.split(",") if part.strip()]
    expected = 1 if name == Distribution.CONSTANT.value else 2
    known = name in {member.value for member in Distribution}
    if not known or len(parts) != expected:
        raise ConfigError(f"link specification {text!r} not understood; {_HELP}")
    values: dict[str, Any] = {"distribution": Distribution(name), "mean": parse_duration(parts[0])}
    if expected == 2:
        values["sd"] = parse_duration(parts[1])
    return values


def _option(option: str, text: str) -> dict[str, Any]:
    """Parse ``key=value`` behind the distribution."""
    key, _, value = option.partition("=")
    if key == "corr":
        return {"correlation": parse_duration(value)}
    if key == "order" and value in {"keep", "free"}:
        return {"keep_order": value == "keep"}
    try:
        if key == "loss":
            return {"loss": 0.01 * float(value[:-1]) if value.endswith("%") else float(value)}
        if key == "seed":
            return {"seed": int(value)}
    except ValueError as error:
        raise ConfigError(f"link option {option!r} in {text!r} is not a number") from error
    raise ConfigError(f"unknown link option {option!r} in {text!r}; {_HELP}")


def _duration(seconds: float) -> str:
    """Write a duration the way :func:`parse_duration` reads it."""
    return f"{seconds:g}s" if seconds >= 1.0 else f"{1e3 * seconds:g}ms"
