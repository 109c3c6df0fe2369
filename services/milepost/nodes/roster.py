"""Which units the fuser hears, how long ago, and which it waits for."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from milepost.estimation.shares import Shares
from milepost.estimation.timeline import Observation

STALE_NS = 1_000_000_000
# how far back a unit's accuracy is looked for; twice its period where that is longer, or a slow unit would seem to know nothing
WINDOW_NS = 1_000_000_000
# before anything was fused nobody is the more accurate
UNKNOWN = (0.0, 0.0, 0.0)
KEPT_TIMES = 4096


@dataclass(frozen=True, slots=True)
class UnitRow:
    """A unit's row in the train file, `order` from 0. `period_ns` None: never due. `fused`: a filter speaks for it."""

    unit: str
    order: int
    period_ns: int | None
    fused: bool


@dataclass(slots=True)
class _Unit:
    row: UnitRow
    times: list[int] = field(default_factory=list)
    # time, then h²/R of position, speed and acceleration
    recent_information: list[tuple[int, float, float, float]] = field(default_factory=list)
    arrived_ns: int = 0
    punctual: bool = True
    gone: set[str] = field(default_factory=set)

    @property
    def window_ns(self) -> int:
        return max(WINDOW_NS, 2 * (self.row.period_ns or 0))

    def last_at(self, at_ns: int) -> int | None:
        place = bisect_right(self.times, at_ns)
        return self.times[place - 1] if place else None


@dataclass(frozen=True, slots=True)
class Presence:
    """The units at an epoch: ages in seconds and shares of those in use, reasons of those that are not."""

    ages_s: Mapping[str, float]
    shares: Mapping[str, float]
    excluded: Mapping[str, str]


class Roster:
    """Times of every unit's observations, tokens that are gone, and punctuality.

    An epoch waits for a unit whose reading is due (its last time + its period ≤ the epoch) and has not come. A unit that
    let a deadline pass is not waited for until a reading of it comes within `deadline_ns` of being measured again.
    """

    def __init__(self, rows: list[UnitRow], shares: Shares, deadline_ns: int) -> None:
        self._units = {row.unit: _Unit(row) for row in rows}
        self._shares = shares
        self._deadline_ns = deadline_ns

    def saw(self, observation: Observation, now_ns: int) -> None:
        """An observation was taken."""
        unit, measured_at_ns = observation.unit, observation.measured_at_ns
        known = self._units[unit]
        if self._shares.by_information:
            h0, h1, h2 = observation.row[:3]
            R = observation.variance
            insort(known.recent_information, (measured_at_ns, h0 * h0 / R, h1 * h1 / R, h2 * h2 / R))
        insort(known.times, measured_at_ns)
        if len(known.times) > 2 * KEPT_TIMES:
            del known.times[:KEPT_TIMES]
        self.arrived(unit, measured_at_ns, now_ns)

    def arrived(self, unit: str, measured_at_ns: int, now_ns: int) -> None:
        """A unit's reading came, whether or not it could be used."""
        known = self._units[unit]
        known.arrived_ns = max(known.arrived_ns, measured_at_ns)
        if now_ns - measured_at_ns <= self._deadline_ns:
            known.punctual = True

    def process_alive(self, process: str, alive: bool) -> None:
        """A process's token appeared or went; a unit is heard through its sensor and its filter, a reader through `balise`."""
        for name, unit in self._units.items():
            speakers = (f"sensor-{name}", f"filter-{name}" if unit.row.fused else "balise")
            if process in speakers:
                (unit.gone.discard if alive else unit.gone.add)(process)

    def all_heard(self) -> bool:
        """Whether every unit with a filter has been heard at least once."""
        return all(unit.times for unit in self._units.values() if unit.row.fused)

    def expect_from(self, at_ns: int) -> None:
        """After a restart: every unit was there at a time, so its next reading is due."""
        for unit in self._units.values():
            unit.arrived_ns = max(unit.arrived_ns, at_ns)

    def missing(self, epoch_ns: int) -> list[str]:
        """The units whose reading is due at or before the epoch and has not come; stale ones are excluded instead."""
        out = []
        for name, unit in self._units.items():
            period = unit.row.period_ns
            last = max(unit.times[-1] if unit.times else 0, unit.arrived_ns)
            if period is None or last == 0:
                continue
            if last + period <= epoch_ns and epoch_ns - last <= max(STALE_NS, 3 * period):
                out.append(name)
        return out

    def worth_waiting(self, missing: list[str]) -> list[str]:
        """Those of the missing that are punctual and alive."""
        return [name for name in missing if self._units[name].punctual and not self._units[name].gone]

    def missed_deadline(self, unit: str) -> None:
        """An epoch was sent without a unit that it had waited for."""
        self._units[unit].punctual = False

    def at(self, epoch_ns: int, live: bool, speed_mps: float = 0.0, variances: Sequence[float] = UNKNOWN) -> Presence:
        """Who counts at an epoch, with shares at a speed and at variances of [s, v, a].

        Tokens matter only live: a settled state is a function of what was observed.
        """
        ages: dict[str, float] = {}
        excluded: dict[str, str] = {}
        for name, unit in self._units.items():
            gone = live and bool(unit.gone)
            if not unit.row.fused:
                if gone:
                    excluded[name] = "process gone"
                continue
            last = unit.last_at(epoch_ns)
            if gone:
                excluded[name] = "process gone"
            elif last is None:
                excluded[name] = "never heard"
            elif epoch_ns - last > max(STALE_NS, 3 * (unit.row.period_ns or 0)):
                heard = unit.arrived_ns > last and epoch_ns - unit.arrived_ns <= STALE_NS
                excluded[name] = "no usable reading" if live and heard else "silent"
            else:
                ages[name] = (epoch_ns - last) * 1e-9
        return Presence(ages, self._shares_of(list(ages), epoch_ns, speed_mps, variances), excluded)

    def shared(self, presence: Presence, epoch_ns: int, speed_mps: float, variances: Sequence[float]) -> Presence:
        """The same with the shares that go with a fused state: its speed, its variances of [s, v, a]."""
        if not self._shares.follows_state:
            return presence
        return replace(presence, shares=self._shares_of(list(presence.ages_s), epoch_ns, speed_mps, variances))

    def _shares_of(self, reporting: list[str], epoch_ns: int, speed_mps: float, variances: Sequence[float]) -> dict[str, float]:
        information: dict[str, float] = {}
        if self._shares.by_information:
            information = {unit: self._information(unit, epoch_ns, variances) for unit in reporting}
        return self._shares.at(reporting, speed_mps, information)

    def _information(self, unit: str, epoch_ns: int, variances: Sequence[float]) -> float:
        recent_information, window_ns = self._units[unit].recent_information, self._units[unit].window_ns
        first = bisect_right(recent_information, epoch_ns - window_ns, key=lambda b: b[0])
        last = bisect_right(recent_information, epoch_ns, key=lambda b: b[0])
        ps, pv, pa = variances[:3]
        return sum(s * ps + v * pv + a * pa for _, s, v, a in recent_information[first:last]) * WINDOW_NS / window_ns

    def forget(self, before_ns: int) -> None:
        """Drop times that no epoch will ask for; the last one before stays: it tells how old a silent unit is."""
        for unit in self._units.values():
            del unit.times[: max(0, bisect_left(unit.times, before_ns) - 1)]
            del unit.recent_information[: bisect_left(unit.recent_information, before_ns - unit.window_ns, key=lambda b: b[0])]
