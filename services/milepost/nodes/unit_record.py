"""What the fuser keeps of one unit: when its readings came, which counted, which were refused and why."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple

from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.verdicts import Verdict
from milepost.sensors.base import Pause

from .working_states import AHEAD, LATE, NO_USE, SILENT

STALE_NS = 1_000_000_000
# the window over which a unit's information is summed; twice its period where that is longer, so that it holds a reading
WINDOW_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class UnitRow:
    """A unit's row in the train file, `order` from 0.

    `period_ns` None: never due. `fused`: a filter speaks for it. `latency_ns`: from the time at which a reading is true to the
    time at which the sensor can send it. `pause`: how long a device that works may be unheard on a train that hardly moves.
    """

    unit: str
    order: int
    period_ns: int | None
    fused: bool
    latency_ns: int = 0
    pause: Pause | None = None


class UnitMemory(NamedTuple):
    """What another fuser may take over of a unit's record."""

    times: list[int]
    refusals: list[tuple[int, str, bool]]
    recent_ns: list[int]
    recent: tuple[list[float], list[float], list[float]]
    arrived_ns: int
    received_ns: int
    behind_ns: int
    punctual: bool


@dataclass(slots=True)
class UnitRecord:
    """The record of a unit.

    `times` of the readings that count; `refusals` (time, reason, whether gating); `recent` h²/R of [s, v, a] of the rows at
    `recent_ns`. `received_ns`: when the last reading came; `behind_ns`: how long after it could have been sent. `gone`: its
    processes whose tokens are gone, which each fuser sees by itself.
    """

    row: UnitRow
    times: list[int] = field(default_factory=list)
    refusals: list[tuple[int, str, bool]] = field(default_factory=list)
    recent_ns: list[int] = field(default_factory=list)
    recent: tuple[list[float], list[float], list[float]] = field(default_factory=lambda: ([], [], []))
    arrived_ns: int = 0
    received_ns: int = 0
    behind_ns: int = 0
    punctual: bool = True
    gone: set[str] = field(default_factory=set)

    window_ns: int = field(init=False)
    stale_ns: int = field(init=False)

    def __post_init__(self) -> None:
        period_ns = self.row.period_ns or 0
        self.window_ns, self.stale_ns = max(WINDOW_NS, 2 * period_ns), max(STALE_NS, 3 * period_ns)

    def stale_at(self, speed_mps: float) -> int:
        """For how many ns the unit may be unheard at a speed before it is not in use."""
        pause = self.row.pause
        if pause is None or abs(speed_mps) >= pause.below_mps:
            return self.stale_ns
        return max(self.stale_ns, round(pause.longest_s * NS_PER_S) + (self.row.period_ns or 0))

    @property
    def memory(self) -> UnitMemory:
        """A copy of what is remembered."""
        s, v, a = self.recent
        return UnitMemory(
            list(self.times),
            list(self.refusals),
            list(self.recent_ns),
            (list(s), list(v), list(a)),
            self.arrived_ns,
            self.received_ns,
            self.behind_ns,
            self.punctual,
        )

    @memory.setter
    def memory(self, other: UnitMemory) -> None:
        self.times, self.refusals, self.recent_ns, self.recent = other[:4]
        self.arrived_ns, self.received_ns, self.behind_ns, self.punctual = other[4:]

    def verdict_at(self, at_ns: int) -> Verdict:
        """The verdict by the filter's judgements: the last reading that counts, and the last refusal after it."""
        place = bisect_right(self.times, at_ns)
        counted_ns = self.times[place - 1] if place else None
        place = bisect_right(self.refusals, at_ns, key=itemgetter(0))
        if not place:
            return Verdict(None, counted_ns, counted_ns)
        heard_ns, why, gating = self.refusals[place - 1]
        if counted_ns is not None and counted_ns >= heard_ns:
            return Verdict(None, counted_ns, counted_ns)
        return Verdict(None, heard_ns, counted_ns, why if gating else None, why)

    def information(self, at_ns: int, variances: Sequence[float]) -> float:
        """The information J = Σ h P hᵀ/R over the window, per second."""
        window_ns = self.window_ns
        first, last = bisect_right(self.recent_ns, at_ns - window_ns), bisect_right(self.recent_ns, at_ns)
        s, v, a = self.recent
        P_ss, P_vv, P_aa = variances
        total = P_ss * sum(s[first:last]) + P_vv * sum(v[first:last]) + P_aa * sum(a[first:last])
        return total * WINDOW_NS / window_ns

    def instead_of_silent(self, epoch_ns: int) -> str:
        """What a unit does of which no reading is about the time before an epoch: it may be heard all the same."""
        if epoch_ns - self.arrived_ns <= self.stale_ns:
            return NO_USE
        if epoch_ns - self.received_ns > self.stale_ns:
            return SILENT
        if self.behind_ns < 0:
            return AHEAD
        return LATE if self.behind_ns > self.stale_ns // 2 else SILENT

    def forget(self, before_ns: int) -> None:
        """Drop what no epoch needs any more; the last time before stays, from which a silent unit's age follows."""
        del self.times[: max(0, bisect_left(self.times, before_ns) - 1)]
        del self.refusals[: max(0, bisect_left(self.refusals, before_ns, key=itemgetter(0)) - 1)]
        place = bisect_left(self.recent_ns, before_ns - self.window_ns)
        for column in (self.recent_ns, *self.recent):
            del column[:place]
