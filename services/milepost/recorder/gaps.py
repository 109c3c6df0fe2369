"""Missing sequence numbers, by who sent them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

# beyond these senders, which only a stranger can make, nobody is followed
MOST_SENDERS = 4096
# so many gaps of a sender are remembered by their numbers; all are counted
MOST_GAPS = 256


@dataclass(slots=True)
class Run:
    """The sequence numbers of one sender: the first and the next one expected, how many came, and where some are missing."""

    first: int
    next: int
    came: int = 1
    repeated: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)

    def note(self, sequence: int) -> None:
        """A message came; one that is late fills its gap."""
        if sequence >= self.next:
            if sequence > self.next and len(self.gaps) < MOST_GAPS:
                self.gaps.append((self.next, sequence - 1))
            self.next = sequence + 1
        elif sequence < self.first:
            if sequence < self.first - 1:
                self.gaps.insert(0, (sequence + 1, self.first - 1))
            self.first = sequence
        elif not self._filled(sequence):
            self.repeated += 1
            return
        self.came += 1

    def _filled(self, sequence: int) -> bool:
        """Whether a number was missing; it no longer is."""
        for i, (low, high) in enumerate(self.gaps):
            if low <= sequence <= high:
                self.gaps[i : i + 1] = [gap for gap in ((low, sequence - 1), (sequence + 1, high)) if gap[0] <= gap[1]]
                return True
        return False

    @property
    def missing(self) -> int:
        """How many between the first and the last did not come."""
        return self.next - self.first - self.came


class Gaps:
    """Counts what is missing; a sender that was restarted is another one, as its instance is."""

    def __init__(self) -> None:
        self.runs: dict[Hashable, Run] = {}

    def note(self, sender: Hashable, sequence: int) -> None:
        """A message of a sender came."""
        run = self.runs.get(sender)
        if run is not None:
            run.note(sequence)
        elif len(self.runs) < MOST_SENDERS:
            self.runs[sender] = Run(sequence, sequence + 1)

    @property
    def missing(self) -> int:
        """How many numbers are missing, all senders together."""
        return sum(run.missing for run in self.runs.values())
