"""One time line through the segments of a recording, whose clocks may differ.

Messages carry the monotonic clock of their arrival. It starts anew with every boot of the machine,
while the wall clock may be set back or ahead. So neither can be compared between two processes
that recorded one after the other. The *recording's clock* is the monotonic clock of the first
segment, continued: within a boot it is that clock itself, and after another boot it goes on where
it ended. Time during which nobody recorded counts as it is up to :data:`LONGEST_RESTART_NS`, which
a restart of the recorder may take; a longer pause counts as :data:`PAUSE_NS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

LONGEST_RESTART_NS = 10_000_000_000
"""A longer time without a recorder is a pause [ns]."""
PAUSE_NS = 1_000_000_000
"""What a pause counts as, however long it is [ns]."""
_SAME_CLOCK_NS = 60_000_000_000
"""Where a log does not name the boot, wall and monotonic clock agree to this within one [ns]."""

_CLOCK_NOISE_NS = 100_000_000
"""Two clocks are not read at the same instant; no machine is suspended for less than this [ns]."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Nobody recorded before the segment called ``segment``.

    Attributes:
        segment: name of the file with which recording went on.
        at_ns: when it did, on the recording's clock [ns].
        real_ns: how long it really was [ns]; None if the wall clock was set back meanwhile, or
            is not known.
        counted_ns: how much of it the recording's clock counts [ns].
    """

    segment: str
    at_ns: int
    real_ns: int | None
    counted_ns: int

    def __str__(self) -> str:
        if self.real_ns is None:
            return f"a pause of unknown length before {self.segment}"
        seconds = round(1e-9 * self.real_ns)
        length = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
        return (
            f"a pause of {length} (h:min:s) before {self.segment}, "
            f"counted as {1e-9 * self.counted_ns:g} s"
        )


@dataclass(frozen=True, slots=True)
class _Clock:
    """What a segment's first metadata record says about its process and clocks [ns]."""

    session: str
    boot: str
    wall: int | None
    """Wall clock minus monotonic clock."""
    suspended: int | None
    """Time since boot that the monotonic clock does not count."""

    @classmethod
    def of(cls, origin: Mapping[str, str]) -> "_Clock":
        at = _number(origin, "monotonic_ns")
        wall, boottime = _number(origin, "wall_ns"), _number(origin, "boottime_ns")
        return cls(
            origin.get("session", ""),
            origin.get("boot_id", ""),
            None if at is None or wall is None else wall - at,
            None if at is None or boottime is None else boottime - at,
        )


class TimeLine:
    """The recording's clock; takes in its segments in order.

    Attributes:
        pauses: where nobody recorded for longer than the clock counts, or unknown long.
        shift_ns: recording's clock minus the present segment's monotonic clock.
        wall_offset_ns: wall clock minus the present segment's monotonic clock. The wall clock of a
            boot is that of its first segment, and it never goes back between segments. None if it
            is not known.
    """

    def __init__(self) -> None:
        """Start before the first segment."""
        self.pauses: list[Pause] = []
        self.shift_ns = 0
        self.wall_offset_ns: int | None = None
        self._name = ""
        self._clock = _Clock("", "", None, None)
        self._last: int | None = None
        self._before: tuple[_Clock, int] | None = None
        self._joined = False

    def begin_segment(self, name: str, origin: Mapping[str, str]) -> None:
        """Go on to the segment called ``name`` with this first metadata record."""
        if self._last is not None and self._joined:
            self._before = self._clock, self._last
        self._name, self._clock = name, _Clock.of(origin)
        self._joined = False

    def place(self, log_time: int) -> int:
        """Return the time of an arrival in the present segment on the recording's clock [ns]."""
        if not self._joined:
            self._join(log_time)
            self._joined, self._last = True, log_time
        elif self._last is None or log_time > self._last:
            self._last = log_time
        return log_time + self.shift_ns

    def _join(self, first: int) -> None:
        """Place a segment whose first message arrived at ``first``."""
        if self._before is None:
            self.wall_offset_ns = self._clock.wall
            return
        before, last = self._before
        if before.session and before.session == self._clock.session:
            self._add_suspended(before)
            return
        gap = None
        if first >= last and _same_boot(before, self._clock):
            gap = first - last + self._add_suspended(before)
        end_ns = last + self.shift_ns
        if gap is None:
            gap = self._go_by_wall_clock(first, last)
        counted = 0 if gap is None else gap if gap <= LONGEST_RESTART_NS else PAUSE_NS
        self.shift_ns = end_ns + counted - first
        if gap is None or gap > counted:
            self.pauses.append(Pause(self._name, end_ns + counted, gap, counted))

    def _add_suspended(self, before: _Clock) -> int:
        """Move the wall clock on by the time that the machine was suspended; return that [ns]."""
        now = self._clock
        if self.wall_offset_ns is None:
            self.wall_offset_ns = now.wall
            return 0
        if before.suspended is None or now.suspended is None:
            return 0
        slept = now.suspended - before.suspended
        if slept <= _CLOCK_NOISE_NS:
            return 0
        self.wall_offset_ns += slept
        return slept

    def _go_by_wall_clock(self, first: int, last: int) -> int | None:
        """Take over the segment's wall clock; return the gap by it [ns], None if it went back."""
        offset = self._clock.wall
        if self.wall_offset_ns is None or offset is None:
            self.wall_offset_ns = offset
            return None
        end_ns = last + self.wall_offset_ns
        gap = first + offset - end_ns
        self.wall_offset_ns = max(offset, end_ns - first)
        return gap if gap >= 0 else None


def _same_boot(before: _Clock, now: _Clock) -> bool:
    if before.boot and now.boot:
        return before.boot == now.boot
    if before.wall is None or now.wall is None:
        return True
    return abs(now.wall - before.wall) <= _SAME_CLOCK_NS


def _number(origin: Mapping[str, str], name: str) -> int | None:
    try:
        return int(origin[name])
    except (KeyError, ValueError):
        return None
