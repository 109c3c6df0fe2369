"""The interface of what learns a unit's noise from its readings, at one belief or at many at once.

A learner is pure: its memory is an argument and a result of each call, so that a timeline which rewinds takes back what
was learned. A memory is a tuple of arrays whose first axis is that of the beliefs, one entry for each of m, or one for all.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.time_units import S_PER_NS

from ..layout import Array

Flags = NDArray[np.bool_]


class Seen(NamedTuple):
    """A scalar observation at m beliefs: z, R as stated, ν = z - h x̂ and c = h P hᵀ, each (m) or, where alike for all, (1)."""

    value: Array
    variance: Array
    innovation: Array
    predicted: Array


class Judged(NamedTuple):
    """The observation that counts: z' and R', (m) or (1)."""

    value: Array
    variance: Array

    @property
    def unusable(self) -> Flags:
        """Where the arithmetic failed."""
        return ~(np.isfinite(self.value) & np.isfinite(self.variance) & (self.variance > 0.0))

    def stated_where(self, unusable: Flags, seen: Seen) -> Judged:
        """As it was seen where it is not usable."""
        value, variance = np.where(unusable, seen.value, self.value), np.where(unusable, seen.variance, self.variance)
        return Judged(value, variance)


class Learner(Protocol):
    """Learns from one component of a unit's readings. `needs_belief`: from ν and c; otherwise from z alone."""

    needs_belief: ClassVar[bool]

    def begin(self, variance: Array) -> Any:
        """The memory before the first reading, which states R."""

    def take(self, memory: Any, dt_s: float, seen: Seen) -> tuple[Judged, Any]:
        """A reading, `dt_s` after the last (0 for the first), as it counts, and the memory after it."""

    def judge(self, memory: Any, seen: Seen) -> Judged:
        """A reading as it counts, without learning from it."""


class Learned(NamedTuple):
    """What was learned from one component of a unit's readings, the last of which is true at `at_ns`."""

    at_ns: int
    memory: Any


def learned(
    learner: Learner, last: Learned | None, at_ns: int, seen: Seen, absent: Flags | None = None
) -> tuple[Judged, Learned]:
    """A reading as it counts, and what is learned after it.

    Where a belief has no such row, `absent` (m), and where the arithmetic fails, nothing is learned and it counts as stated.
    """
    if last is None:
        last = Learned(at_ns, learner.begin(seen.variance))
    with np.errstate(all="ignore"):
        judged, memory = learner.take(last.memory, (at_ns - last.at_ns) * S_PER_NS, seen)
    unusable = judged.unusable
    if absent is not None or unusable.any():
        unusable = unusable if absent is None else unusable | absent
        memory, judged = kept_where(unusable, last.memory, memory), judged.stated_where(unusable, seen)
    return judged, Learned(at_ns, memory)


def unlearned(learner: Learner, last: Learned, seen: Seen) -> Judged:
    """A reading as it counts by what was learned before, as stated where the arithmetic fails."""
    with np.errstate(all="ignore"):
        judged = learner.judge(last.memory, seen)
    return judged.stated_where(judged.unusable, seen)


def continued(memory: Any, index: list[int]) -> Any:
    """The memory for other beliefs, each the continuation of the one at its place in `index`."""
    if isinstance(memory, tuple):
        return type(memory)(*(continued(part, index) for part in memory))
    return memory[index] if len(memory) > 1 else memory


def kept_where(kept: Flags, old: Any, new: Any) -> Any:
    """The memory `new`, but `old` for the beliefs (m) that keep it."""
    if isinstance(new, tuple):
        return type(new)(*(kept_where(kept, *parts) for parts in zip(old, new, strict=True)))
    return np.where(kept.reshape(-1, *(1,) * (new.ndim - 1)), old, new)
