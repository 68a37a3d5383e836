"""Builds the frames of an episode, twenty times a second, of what was newest at a moment; pure.

Each set-point of the operator makes one frame. Its measurements are the newest that the robot had
at that moment, its pictures the newest that had arrived then; ``time/seen_ns`` is the time of what
the operator itself had seen, which a delayed link makes older. Where no set-point comes in time,
as between two operators, the frame holds the last one, as the robot does.
"""

from typing import Generic, NamedTuple, TypeVar

from common.episodes.columns import Rows
from common.episodes.episode_file import PERIOD_NS, Operator
from common.episodes.observation import Frame, action, observation, times, truth
from common.operator.holds import Hold, HoldBook
from common.schemas import (
    ControllerState,
    GaitRequest,
    Header,
    OperatorKind,
    PlantState,
    SceneState,
    Setpoint,
)

P = TypeVar("P")
_NAMES: dict[OperatorKind, Operator] = {
    OperatorKind.POLICY: "policy",
    OperatorKind.SCRIPT: "synthetic",
    OperatorKind.PERSON: "person",
}


class Picture(NamedTuple, Generic[P]):
    """A stereo pair, when it was taken [ns], and what the frames refer to it by."""

    stamp: int
    pair: P


class Moment(NamedTuple, Generic[P]):
    """What was newest at one moment.

    Attributes:
        now_ns: robot time [ns].
        state: measurements.
        controller: state of the controller.
        picture: the stereo pair; None: the robot has no cameras.
        truth: ground truth of robot and scene; None: nobody knows it.
        slipping: whether a hand of the operator is knocked off its way, as far as is known.
    """

    now_ns: int
    state: PlantState
    controller: ControllerState
    picture: Picture[P] | None
    truth: tuple[PlantState, SceneState] | None
    slipping: bool = False


class EpisodeFrames(Generic[P]):
    """The frames of one episode.

    Frames lie within half a period of a grid that begins with the first one, one in each place.

    Attributes:
        rows: the frames so far.
        pictures: what each frame's stereo pair is referred to by; empty without cameras.
        operators: kinds of those whose set-points made frames.
        worst_ns: furthest that a frame is off its place in the grid [ns].
    """

    def __init__(self, holds: HoldBook | None = None) -> None:
        """Begin without frames.

        Args:
            holds: who has the robot: set-points of others make no frames, and an intervention is
                marked; None: there is only one operator, which makes no mark.
        """
        self.rows = Rows()
        self.pictures: list[P] = []
        self.operators: set[OperatorKind] = set()
        self.worst_ns = 0
        self._holds = holds
        self._first_ns = 0
        self._next = 0
        """Number of the first place in the grid behind the last frame."""
        self._held: Setpoint | None = None
        self._hold: Hold | None = None
        """Of whoever gave the set-point that is held."""
        self._due: Moment[P] | None = None
        self._setpoints: list[tuple[Header, int]] = []
        """Headers of set-points with their frames."""
        self._gaits: list[GaitRequest] = []
        """Requests whose set-point has not come yet."""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def operator(self) -> Operator:
        """Who operated the robot, where it is known who had it."""
        if len(self.operators) == 1:
            return _NAMES[next(iter(self.operators))]
        return "mixed" if OperatorKind.POLICY in self.operators else "person"

    def tick(self, moment: Moment[P]) -> None:
        """Pass a place in the grid; if no set-point comes before the next, a frame shows this."""
        place = self._place(moment.now_ns)
        if self._held is not None and place >= self._next:
            self._fill(place)
            self._due = moment

    def is_due(self, now_ns: int) -> bool:
        """Return whether the next place has come, and with it the time of :meth:`tick`."""
        place = self._next + (self._due is not None)
        return self._held is not None and now_ns >= self._first_ns + place * PERIOD_NS

    def setpoint(self, setpoint: Setpoint, moment: Moment[P]) -> None:
        """Make a frame of a set-point that was given at a moment."""
        hold = self._holds.present if self._holds is not None else None
        if self._holds is not None and (hold is None or hold.holder != setpoint.header.sender):
            return
        if self._held is None:
            self._first_ns = moment.now_ns
        place = self._place(moment.now_ns)
        self._fill(place)
        self._held, self._hold = setpoint, hold
        if place >= self._next:
            self._append(moment)
        self._setpoints.append((setpoint.header, len(self) - 1))
        for request in [r for r in self._gaits if _same_sample(r.header, setpoint.header)]:
            self._gaits.remove(request)
            self._ask_for(request, len(self) - 1)

    def gait(self, request: GaitRequest) -> None:
        """Put a request into the frame of its set-point, which may come before or after it."""
        for setpoint, frame in self._setpoints:
            if _same_sample(request.header, setpoint):
                self._ask_for(request, frame)
                return
        self._gaits.append(request)

    def _place(self, now_ns: int) -> int:
        """Return the number of the place in the grid that is nearest to a moment."""
        return (now_ns - self._first_ns + PERIOD_NS // 2) // PERIOD_NS

    def _fill(self, place: int) -> None:
        """Make the frame that is due in a place before ``place``, holding the last set-point."""
        due, self._due = self._due, None
        if due is not None and self._next <= self._place(due.now_ns) < place:
            self._append(due)

    def _append(self, moment: Moment[P]) -> None:
        assert self._held is not None
        place, hold = self._place(moment.now_ns), self._hold
        self._next = place + 1
        self.worst_ns = max(self.worst_ns, abs(moment.now_ns - self._first_ns - place * PERIOD_NS))
        if hold is not None:
            self.operators.add(hold.kind)
        intervention = hold is not None and hold.intervention
        for path, value in _frame(moment, self._held, intervention).items():
            self.rows.rows[path].append(value)
        if moment.picture is not None:
            self.pictures.append(moment.picture.pair)

    def _ask_for(self, request: GaitRequest, frame: int) -> None:
        self.rows.rows["action/locomotion"][frame] = int(request.gait)


def _frame(moment: Moment[P], setpoint: Setpoint, intervention: bool) -> Frame:
    """Return the columns of a frame."""
    stamps = {
        "state": moment.state.header.stamp,
        "controller": moment.controller.header.stamp,
        "seen": setpoint.header.stamp,
    }
    if moment.picture is not None:
        stamps["picture"] = moment.picture.stamp
    if moment.truth is not None:
        stamps["truth"] = moment.truth[0].header.stamp
    frame = times(moment.now_ns, **stamps) | {"intervention": intervention}
    frame |= observation(moment.state, moment.controller) | action(setpoint)
    frame["action/slip"] = float(moment.slipping)
    return frame | (truth(*moment.truth) if moment.truth is not None else {})


def _same_sample(one: Header, other: Header) -> bool:
    """Return whether the operator gave two messages together.

    They then carry the time of what it saw. While it sees nothing new its later messages carry the
    same, but were captured a period later.
    """
    return one.stamp == other.stamp and 2 * abs(one.captured - other.captured) < PERIOD_NS
