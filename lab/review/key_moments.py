"""Choose the moments of a run that are worth a picture. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.robot.joints import LEFT_ARM, RIGHT_ARM
from common.schemas import PlantState
from lab.review.message_spool import MessageSpool
from lab.review.timeline import Section, Timeline

FELL = "FELL"
MAX_MOMENTS = 24
"""Pictures from outside of a contact sheet."""
SWING_SHARE = 0.55
"""Part of a gait after which a foot is well in the air."""


@dataclass(frozen=True)
class Moment:
    """One picture of the contact sheet: the ground truth at ``index``, captioned ``label``."""

    index: int
    label: str


def key_moments(timeline: Timeline, spare: int = 6) -> list[Moment]:
    """Choose the moments worth a picture, in order of time.

    In a section with gaits that is the first gait of each type, mid swing; in any other section
    it is when arms and grippers had moved furthest. If the operator gave no labels, ``spare``
    evenly spaced moments are added. A fall and hand-overs between
    a policy and other operators are always shown. For a run with very many see :func:`at_most`.
    """
    if not timeline.truth:
        return []
    chosen: list[Moment] = []
    seen: set[str] = set()
    for section in timeline.sections():
        gaits = [span for span in timeline.gaits if section.start <= span.start <= section.end]
        for span in gaits:
            if span.name not in seen:
                seen.add(span.name)
                middle = span.start + round(SWING_SHARE * (span.end - span.start))
                chosen.append(Moment(middle, span.name))
        if not gaits and section.label:
            chosen.append(Moment(_furthest_moved(timeline.truth, section), section.label))
    if not timeline.labels:
        last = len(timeline.truth) - 1
        chosen += [Moment(last * number // spare, "") for number in range(spare + 1)]
    chosen += [Moment(index, text) for index, text in timeline.handovers]
    if timeline.fall is not None:
        chosen.append(Moment(timeline.fall, FELL))
    unique = {moment.index: moment for moment in chosen}
    return at_most(MAX_MOMENTS, [unique[index] for index in sorted(unique)])


def at_most(count: int, moments: Sequence[Moment]) -> list[Moment]:
    """Choose the first moment of each label, or some of these, if there are more than ``count``."""
    if len(moments) <= count:
        return list(moments)
    first = {moment.label: moment for moment in reversed(moments)}
    ordered = sorted(first.values(), key=lambda moment: moment.index)
    if len(ordered) <= count:
        return ordered
    falls = {place for place, one in enumerate(ordered) if FELL in one.label}
    spread = np.linspace(0, len(ordered) - 1, count - len(falls)).round().astype(int)
    return [ordered[place] for place in sorted(falls.union(spread.tolist()))]


def _furthest_moved(truth: MessageSpool[PlantState], section: Section) -> int:
    """Return when arms and grippers were furthest from where they were at the section's start."""
    start = _posture(truth[section.start])
    moved = [
        float(np.linalg.norm(_posture(truth[index]) - start))
        for index in range(section.start, section.end + 1)
    ]
    # The last of equals: a section in which nothing moves is shown at its end.
    return section.end - int(np.argmax(np.round(moved[::-1], 3)))


def _posture(state: PlantState) -> NDArray[np.float64]:
    """Return arm joints [rad] and grippers, whose full stroke counts as much as two radians."""
    arms = state.joint_position[np.r_[LEFT_ARM, RIGHT_ARM]]
    return np.concatenate([arms, 2.0 * state.gripper_closure])
