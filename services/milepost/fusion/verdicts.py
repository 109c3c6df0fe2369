"""What is known of each unit: its judge's memory, when it counted last, why it is excluded."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from milepost.estimation.noise.learner import Learned, continued

from .course import Course
from .evidence import KINDS, OUT_OF_RANGE, SHORT, STUCK, window_of

# a wheel whose speed differs from the train's by this part slips
SLIP_RATIO = 0.02
# what is said of a unit at first, and what its course may show it to be instead
SHOWN = {
    "jumping": ("drifting", "intermittent"),
    "biased": ("drifting", "intermittent"),
    "noisy": ("biased", "drifting", "intermittent"),
}


class Exclusion(NamedTuple):
    """Why a unit was excluded: the unit whose test fired, the test, its value in σ, the innovation and the speed then."""

    at_ns: int
    found_by: str
    test: int
    value: float
    innovation: float
    speed_mps: float
    slips: bool = False
    limit: float = 0.0

    @property
    def sudden(self) -> bool:
        """Whether a few readings told."""
        return window_of(self.test) <= SHORT

    @property
    def slipping(self) -> bool:
        """Whether it is a wheel whose speed is far from the train's."""
        return self.slips and abs(self.innovation) > SLIP_RATIO * abs(self.speed_mps)

    @property
    def kind(self) -> str:
        """What the unit does: the name of the test, or how a wheel slips."""
        if self.slipping:
            return "spinning" if self.innovation * self.speed_mps > 0.0 else "sliding"
        return KINDS[self.test]

    @property
    def evidence(self) -> str:
        """The evidence in words."""
        if self.test == STUCK:
            return f"{self.found_by} says the same again and again"
        if self.test == OUT_OF_RANGE:
            return f"{self.found_by}: what was learned of it is farther from its prior than any such device is"
        if math.isinf(self.value):
            return f"{self.found_by}: its fix is too far from where the train would be"
        window = window_of(self.test)
        what = "innovation is" if window == 1 else f"last {window} innovations are"
        return f"{self.found_by}: its {what} {self.value:.1f} σ off (limit {self.limit:.1f})"


class Reset(NamedTuple):
    """A step of the published state by more than its own uncertainty."""

    at_ns: int
    size_m: float
    size_mps: float
    reason: str


class Verdict(NamedTuple):
    """The last verdict on a unit, and its judge's memory.

    `heard_ns`, `counted_ns`: the times of the last reading, and of the last one that counted. `gating`: the reason for which
    no reading counts at present. `refused`: the reason for which the last reading did not count. `memory` is immutable.
    `said`, `repeats`: what it said last, and how often in a row before. `excluded`: why the unit is left out; `probation_ns`:
    since when it agrees again, with `agreed` readings; `relapses`: how often it was excluded. `odd_ns`: the times of the last
    readings that were refused by themselves. `course`: what it does while it is excluded. `noise`: what
    each hypothesis learned from each component of its readings.
    """

    memory: Any
    heard_ns: int | None = None
    counted_ns: int | None = None
    gating: str | None = None
    refused: str | None = None
    said: Any = None
    repeats: int = 0
    excluded: Exclusion | None = None
    probation_ns: int = 0
    agreed: int = 0
    relapses: int = 0
    odd_ns: tuple[int, ...] = ()
    course: Course = Course()
    noise: tuple[Learned, ...] = ()

    def told(
        self, said: Any, memory: Any, at_ns: int, counted_ns: int | None, gating: str | None, refused: str | None
    ) -> Verdict:
        """The verdict after one more reading; `said`: what it measured, None where it may say the same again."""
        repeats = self.repeats + 1 if said is not None and said == self.said else 0
        # what each reading changes comes first: `_replace` takes four times as long
        return Verdict(memory, at_ns, counted_ns, gating, refused, said, repeats, *self[7:])

    def continued(self, index: list[int]) -> Verdict:
        """The verdict with the noise of other rows, each the continuation of the row `index`."""
        return self._replace(noise=tuple(n._replace(memory=continued(n.memory, index)) for n in self.noise))

    @property
    def kind(self) -> str | None:
        """What an excluded unit does: what its course shows, else what excluded it; None where it is not excluded."""
        if self.excluded is None:
            return None
        return self._shown.kind if self._shown is not None else self.excluded.kind

    @property
    def evidence(self) -> str:
        """The evidence of that in words."""
        if self.excluded is None:
            return ""
        return self._shown.evidence if self._shown is not None else self.excluded.evidence

    @property
    def _shown(self) -> Course | None:
        """The course, where it tells better than the test that excluded the unit."""
        if self.excluded is None:
            return None
        course = self.course.excluded(self.excluded.at_ns, self.excluded.sudden)
        return course if course.kind in SHOWN.get(self.excluded.kind, ()) else None

    def watched(self, at_ns: int, e: float) -> Verdict:
        """The verdict on an excluded unit after its innovation e, in σ of the hypothesis that leads."""
        if self.excluded is None:
            return self
        course = self.course.excluded(self.excluded.at_ns, self.excluded.sudden)
        return self._replace(course=course.heard(at_ns, e))
