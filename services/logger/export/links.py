"""One input of a service as plain numbers, which every viewer can plot."""

from math import nan

from pydantic import BaseModel, ConfigDict, create_model

from common.journal.stages import STAGES
from common.schemas import LinkHealth

_SOURCES = {
    name: name
    for name in (
        "age", "rate", "received", "gaps", "late", "skipped", "stale", "refused", "lost", "link",
    )
} | {
    f"injected_{name}": name
    for name in ("requested_mean", "requested_p99", "achieved_mean", "achieved_p99")
}  # fmt: skip
"""Fields of :class:`LinkPlot` and those of :class:`~common.schemas.LinkHealth` behind them."""
_STAGE_FIELDS = [f"{stage}_{figure}" for stage in STAGES for figure in ("median", "p99")]

LinkPlot: type[BaseModel] = create_model(  # type: ignore[call-overload]
    "LinkPlot",
    __config__=ConfigDict(frozen=True, extra="forbid"),
    **{
        name: (LinkHealth.model_fields[source].annotation, ...) for name, source in _SOURCES.items()
    },
    **dict.fromkeys(_STAGE_FIELDS, (float, nan)),
)
"""A link's health with its stages laid flat: times in seconds, NaN where nothing is known.

A curve has a gap there; a number such as -1 would be drawn, and spoil the scale.
"""


def link_plot(link: LinkHealth) -> BaseModel:
    """Return the numbers of ``link`` as a :data:`LinkPlot`."""
    values = {name: getattr(link, source) for name, source in _SOURCES.items()}
    values["age"] = link.age if link.age >= 0.0 else nan
    for stage in link.stages:
        values[f"{stage.stage}_median"] = stage.median
        values[f"{stage.stage}_p99"] = stage.p99
    return LinkPlot(**values)
