"""The result of a replay: what was compared, and the first difference."""

from collections import defaultdict
from dataclasses import dataclass, field

from common.runtime.replay.difference import FieldDifference


@dataclass(frozen=True)
class Difference:
    """The earliest difference between a replay and the recording.

    Attributes:
        step: number of the step in the service's run.
        now_ns: its time on the service's clock [ns].
        topic: of the message.
        seq: its number.
        what: ``differs``, ``missing`` (recorded, not replayed) or ``extra`` (the reverse).
        fields: where it differs.
    """

    step: int
    now_ns: int
    topic: str
    seq: int
    what: str
    fields: tuple[FieldDifference, ...] = ()


@dataclass
class OutputCounts:
    """Counts of the messages of one topic by the result of their comparison."""

    equal: int = 0
    """To the byte."""
    close: int = 0
    """Within the tolerance; or equal in the fields that both have, if the recorded message is of
    another version."""
    differing: int = 0
    missing: int = 0
    """Recorded, not replayed."""
    extra: int = 0
    """Replayed, and the recording should have it but has not."""
    unrecorded: int = 0
    """Replayed, but lost by the recorder or sent before it listened."""

    @property
    def compared(self) -> int:
        """Messages that are in both."""
        return self.equal + self.close + self.differing


@dataclass
class Report:
    """The result of replaying one run of a service; durations in seconds.

    Attributes:
        service, run, boot: the service's name, the number of its run and its boot id.
        steps: steps replayed.
        inputs: messages fed.
        outputs: by topic name.
        first: the first difference; None without any.
        worst: largest relative difference of each field that differs, by ``topic field``.
        stopped: why the replay ended before the run did; empty if it did not.
        failure: the exception that the service raised, if it did.
        replayed: duration of the steps replayed.
        wall: how long the replay took.
    """

    service: str
    run: int
    boot: int
    steps: int = 0
    inputs: int = 0
    outputs: dict[str, OutputCounts] = field(default_factory=lambda: defaultdict(OutputCounts))
    first: Difference | None = None
    worst: dict[str, float] = field(default_factory=dict)
    stopped: str = ""
    failure: str = ""
    replayed: float = 0.0
    wall: float = 0.0

    @property
    def identical(self) -> bool:
        """Whether the replay went to its end and every message compared is the same."""
        return not self.stopped and self.first is None and self.compared > 0

    @property
    def compared(self) -> int:
        """Messages that are in both."""
        return sum(counts.compared for counts in self.outputs.values())

    def note(self, found: Difference) -> None:
        """Keep the earliest difference."""
        if self.first is None or found.step < self.first.step:
            self.first = found
