"""Arranges rows as the paper's tables are: kinds of policy beside one another, and ablations."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from lab.learning.evaluation.names import ABLATIONS, KINDS, PolicyName, policy_name
from lab.learning.evaluation.paper import PAPER, PAPER_TASKS, Rates
from lab.learning.evaluation.summary import Row, label_of, summarise
from lab.trials.operators.specs import PolicySpec
from lab.trials.results import TrialRecord

ABLATED = ("trill", *(f"trill, {name}" for name in ABLATIONS))


class Column(NamedTuple):
    """One policy in several tasks.

    Attributes:
        head: its name, less what the whole comparison has in common.
        rows: what was measured, by task; empty: nothing.
        paper: what the paper reports, by task; empty: nothing.
    """

    head: str
    rows: Mapping[str, Row]
    paper: Mapping[str, Rates]


class Comparison(NamedTuple):
    """Policies that learn and see alike.

    Attributes:
        setting: what they have in common; empty: as published.
        kinds: the kinds of policy, and what success without eyes is.
        ablations: of the policy ``trill``, itself first; empty: there are none.
    """

    setting: str
    kinds: tuple[Column, ...]
    ablations: tuple[Column, ...]


class Named(NamedTuple):
    """A label and what it stands for.

    Attributes:
        name: of the policy.
        baseline: whether it is shown or answers something else, as baselines are.
    """

    name: PolicyName
    baseline: bool


def tasks_of(columns: Iterable[Column]) -> list[str]:
    """Return the tasks in which policies were evaluated, the paper's first."""
    found = {task for column in columns for task in column.rows}
    return [*(task for task in PAPER_TASKS if task in found), *sorted(found - {*PAPER_TASKS})]


def rows_of(records: Iterable[TrialRecord]) -> list[Row]:
    """Return a row for each policy, size of its data set, task and link."""
    return summarise(((record.spec, record.result) for record in records), {})


def names_of(records: Iterable[TrialRecord]) -> dict[str, set[Named]]:
    """Return, by label, the policies that it stands for."""
    found: dict[str, set[Named]] = {}
    for record in records:
        operator = record.spec.operator
        if isinstance(operator, PolicySpec):
            baseline = operator.constant or operator.pictures is not None
            named = Named(policy_name(operator.about.get("policy", {})), baseline)
            found.setdefault(label_of(record.spec), set()).add(named)
    return found


def comparisons(records: Sequence[TrialRecord]) -> list[Comparison]:
    """Return a comparison for each setting in which policies were evaluated."""
    rows, names = _largest(rows_of(records)), names_of(records)
    every = [named.name for found in names.values() for named in found if not named.baseline]
    # Blind policies stand beside those that see.
    seeing = [name for name in every if name.scene != "blind"] or every
    settings = sorted({(name.setting, name.actions) for name in seeing})
    return [_comparison(*setting, rows, names) for setting in settings]


def _comparison(
    setting: str, actions: str, rows: Sequence[Row], names: Mapping[str, set[Named]]
) -> Comparison:
    kinds: dict[str, dict[str, Row]] = {}
    ablated: dict[str, dict[str, Row]] = {}
    # The operator's own column comes last.
    for row in sorted(rows, key=lambda row: row.label not in names):
        policies = sorted(
            one for one in names.get(row.label, ()) if _belongs(one.name, setting, actions)
        )
        if row.label in names and not policies:
            continue
        head = row.label
        if policies and not policies[0].baseline:
            name = policies[0].name
            head = _head(row.label, name, setting)
            if (name.kind, name.setting, row.link) == ("trill", setting, "none"):
                ablated.setdefault(head, {})[row.task] = row
            if name.setting == setting and name.ablations:
                continue
        head = head if row.link == "none" else f"{head}; {row.link}"
        kinds.setdefault(head, {})[row.task] = row
    # A baseline or an ablation is shown beside what it is to be compared with.
    own = {
        row.task
        for row in rows
        if any(one.name.setting == setting for one in names.get(row.label, ()))
    }
    changed = {task for head, cells in ablated.items() if head in ABLATED[1:] for task in cells}
    return Comparison(
        setting,
        _beside_paper(kinds, KINDS, own),
        _beside_paper(ablated, ABLATED, changed) if changed else (),
    )


def _belongs(name: PolicyName, setting: str, actions: str) -> bool:
    """Whether a policy is compared in a setting: it is of it, or a blind one beside it."""
    return name.setting == setting or (name.scene, name.actions) == ("blind", actions)


def _head(label: str, name: PolicyName, setting: str) -> str:
    """Return a label without what the setting says; one that was given stays."""
    if label != str(name):
        return label
    return str(name) if name.setting != setting else str(name._replace(scene="", actions=""))


def _beside_paper(
    found: Mapping[str, Mapping[str, Row]], paper: Sequence[str], tasks: Collection[str]
) -> tuple[Column, ...]:
    """Return columns of what was measured in ``tasks``, and of what the paper reports."""
    heads = [*paper, *(head for head in found if head not in paper)]
    return tuple(
        Column(
            head,
            {task: row for task, row in found.get(head, {}).items() if task in tasks},
            PAPER[head] if head in paper else {},
        )
        for head in heads
    )


def _largest(rows: Sequence[Row]) -> list[Row]:
    """Return, of the rows of one policy, task and link, the one with the most demonstrations."""
    found: dict[tuple[str, str, str], Row] = {}
    for row in rows:
        at = (row.label, row.task, row.link)
        if at not in found or (row.episodes or 0) > (found[at].episodes or 0):
            found[at] = row
    return list(found.values())
