"""Which units the fuser hears, how long ago, and which it waits for."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Mapping
from dataclasses import dataclass, field

from milepost.estimation.federated import share_out

STALE_NS = 1_000_000_000
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
    arrived_ns: int = 0
    punctual: bool = True
    gone: set[str] = field(default_factory=set)

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

    def __init__(self, rows: list[UnitRow], shares: Mapping[str, float], deadline_ns: int) -> None:
        self._units = {row.unit: _Unit(row) for row in rows}
        self._shares = shares
        self._deadline_ns = deadline_ns

    def saw(self, unit: str, measured_at_ns: int, now_ns: int) -> None:
        """An observation of a unit was taken."""
        known = self._units[unit]
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

    def at(self, epoch_ns: int, live: bool) -> Presence:
        """Who counts at an epoch. Tokens matter only live: a settled state is a function of what was observed."""
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
        return Presence(ages, share_out(self._shares, list(ages)), excluded)

    def forget(self, before_ns: int) -> None:
        """Drop times that no epoch will ask for; the last one before stays: it tells how old a silent unit is."""
        for unit in self._units.values():
            del unit.times[: max(0, bisect_left(unit.times, before_ns) - 1)]
