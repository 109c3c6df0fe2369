"""Which units the fuser hears, how long ago, and which it waits for."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from milepost.estimation.judging import Verdict
from milepost.estimation.observation import Observation
from milepost.estimation.shares import Shares
from milepost.estimation.time_units import S_PER_NS

STALE_NS = 1_000_000_000
# how far back a unit's accuracy is looked for; twice its period where that is longer, or a slow unit would seem to know nothing
WINDOW_NS = 1_000_000_000
# before anything was fused nobody is the more accurate
UNKNOWN = (0.0, 0.0, 0.0)
KEPT_TIMES = 4096


@dataclass(frozen=True, slots=True)
class UnitRow:
    """A unit's row in the train file, `order` from 0.

    `period_ns` None: never due. `fused`: a filter speaks for it. `latency_ns`: from the time at which a reading is true to the
    time at which the sensor can send it.
    """

    unit: str
    order: int
    period_ns: int | None
    fused: bool
    latency_ns: int = 0


@dataclass(slots=True)
class _Unit:
    """What is known of a unit.

    `times` of what counted; `refusals` (time, why, whether gating); `recent` h²/R of [s, v, a] of rows at `recent_ns`.
    """

    row: UnitRow
    times: list[int] = field(default_factory=list)
    refusals: list[tuple[int, str, bool]] = field(default_factory=list)
    recent_ns: list[int] = field(default_factory=list)
    recent: tuple[list[float], list[float], list[float]] = field(default_factory=lambda: ([], [], []))
    arrived_ns: int = 0
    punctual: bool = True
    gone: set[str] = field(default_factory=set)

    window_ns: int = field(init=False)
    stale_ns: int = field(init=False)

    def __post_init__(self) -> None:
        period_ns = self.row.period_ns or 0
        self.window_ns, self.stale_ns = max(WINDOW_NS, 2 * period_ns), max(STALE_NS, 3 * period_ns)

    def verdict_at(self, at_ns: int) -> Verdict:
        """What the filter's own judgements make of it: the last that counted, and the last refusal after it."""
        place = bisect_right(self.times, at_ns)
        counted_ns = self.times[place - 1] if place else None
        place = bisect_right(self.refusals, at_ns, key=_time)
        if not place:
            return Verdict(None, counted_ns, counted_ns)
        heard_ns, why, gating = self.refusals[place - 1]
        if counted_ns is not None and counted_ns >= heard_ns:
            return Verdict(None, counted_ns, counted_ns)
        return Verdict(None, heard_ns, counted_ns, why if gating else None, why)

    def information(self, at_ns: int, variances: Sequence[float]) -> float:
        """J = Σ h P hᵀ/R over the window, for a second of it."""
        window_ns = self.window_ns
        first, last = bisect_right(self.recent_ns, at_ns - window_ns), bisect_right(self.recent_ns, at_ns)
        s, v, a = self.recent
        P_ss, P_vv, P_aa = variances
        total = P_ss * sum(s[first:last]) + P_vv * sum(v[first:last]) + P_aa * sum(a[first:last])
        return total * WINDOW_NS / window_ns

    def forget(self, before_ns: int) -> None:
        """Drop what no epoch will ask for; the last time before stays: it tells how old a silent unit is."""
        del self.times[: max(0, bisect_left(self.times, before_ns) - 1)]
        del self.refusals[: max(0, bisect_left(self.refusals, before_ns, key=_time) - 1)]
        place = bisect_left(self.recent_ns, before_ns - self.window_ns)
        for column in (self.recent_ns, *self.recent):
            del column[:place]


def _time(entry: tuple[int, str, bool]) -> int:
    return entry[0]


@dataclass(frozen=True, slots=True)
class Presence:
    """The units at an epoch: ages in seconds and shares of those in use, reasons of those that are not."""

    ages_s: Mapping[str, float]
    shares: Mapping[str, float]
    excluded: Mapping[str, str]


class Roster:
    """Times of every unit's observations, tokens that are gone, and punctuality.

    An epoch waits for a unit whose reading is due and has not come: due is its last time + its period + its latency. A unit
    that let a deadline pass is not waited for until a reading of it comes within `deadline_ns` of being measured again.
    """

    def __init__(self, rows: list[UnitRow], shares: Shares, deadline_ns: int) -> None:
        self._units = {row.unit: _Unit(row) for row in rows}
        self._shares = shares
        self._deadline_ns = deadline_ns

    @property
    def follows_state(self) -> bool:
        """Whether the shares depend on the fused state."""
        return self._shares.follows_state

    def counted(self, unit: str, measured_at_ns: int) -> None:
        """A unit's reading counts."""
        known = self._units[unit]
        insort(known.times, measured_at_ns)
        if len(known.times) > 2 * KEPT_TIMES:
            del known.times[:KEPT_TIMES]

    def refused(self, unit: str, measured_at_ns: int, why: str, gating: bool = False) -> None:
        """A unit's filter let a reading not count; `gating`: nor any other for the time being."""
        known = self._units[unit]
        insort(known.refusals, (measured_at_ns, why, gating))
        if len(known.refusals) > 2 * KEPT_TIMES:
            del known.refusals[:KEPT_TIMES]

    def informed(self, unit: str, observation: Observation) -> None:
        """A unit's row, by which shares that go by accuracy are chosen."""
        if not self._shares.by_information:
            return
        known, R = self._units[unit], observation.variance
        place = bisect_right(known.recent_ns, observation.measured_at_ns)
        known.recent_ns.insert(place, observation.measured_at_ns)
        for column, h in zip(known.recent, observation.row, strict=False):
            column.insert(place, h * h / R)

    def arrived(self, unit: str, measured_at_ns: int, now_ns: int) -> None:
        """A unit's reading came, whether or not it counts."""
        known = self._units[unit]
        known.arrived_ns = max(known.arrived_ns, measured_at_ns)
        if now_ns - measured_at_ns <= self._deadline_ns + known.row.latency_ns:
            known.punctual = True

    def process_alive(self, process: str, alive: bool) -> None:
        """A process's token appeared or went; a unit is heard through its sensor and its filter, a reader through `balise`."""
        for name, unit in self._units.items():
            speakers = (f"sensor-{name}", f"filter-{name}" if unit.row.fused else "balise")
            if process in speakers:
                (unit.gone.discard if alive else unit.gone.add)(process)

    def all_heard(self) -> bool:
        """Whether every unit with a filter has been heard at least once."""
        return all(unit.arrived_ns for unit in self._units.values() if unit.row.fused)

    def expect_from(self, at_ns: int) -> None:
        """After a restart: every unit was there at a time, so its next reading is due."""
        for unit in self._units.values():
            unit.arrived_ns = max(unit.arrived_ns, at_ns)

    def missing(self, epoch_ns: int) -> list[str]:
        """The units whose reading could be there by the epoch and has not come; stale ones are excluded instead."""
        out = []
        for name, unit in self._units.items():
            period, last = unit.row.period_ns, unit.arrived_ns
            if period is not None and last and last + period + unit.row.latency_ns <= epoch_ns <= last + unit.stale_ns:
                out.append(name)
        return out

    def worth_waiting(self, missing: list[str]) -> list[str]:
        """Those of the missing that are punctual and alive."""
        return [name for name in missing if self._units[name].punctual and not self._units[name].gone]

    def missed_deadline(self, unit: str) -> None:
        """An epoch was sent without a unit that it had waited for."""
        self._units[unit].punctual = False

    def at(
        self,
        epoch_ns: int,
        live: bool,
        verdicts: Mapping[str, Verdict],
        speed_mps: float = 0.0,
        variances: Sequence[float] = UNKNOWN,
    ) -> Presence:
        """Who counts at an epoch by the fuser's `verdicts` and the filters', with shares at a speed and variances of [s, v, a].

        Tokens matter only live: a settled state is a function of what was observed.
        """
        ages: dict[str, float] = {}
        excluded: dict[str, str] = {}
        for name, unit in self._units.items():
            if live and unit.gone:
                excluded[name] = "process gone"
            elif unit.row.fused:
                verdict = verdicts.get(name) or unit.verdict_at(epoch_ns)
                reason = _why_not(verdict, epoch_ns, unit.stale_ns)
                if reason == "silent" and live and epoch_ns - unit.arrived_ns <= unit.stale_ns:
                    reason = "no usable reading"
                if reason is not None:
                    excluded[name] = reason
                elif verdict.counted_ns is not None:
                    ages[name] = (epoch_ns - verdict.counted_ns) * S_PER_NS
        return Presence(ages, self._shares_of(list(ages), epoch_ns, speed_mps, variances), excluded)

    def _shares_of(self, reporting: list[str], epoch_ns: int, speed_mps: float, variances: Sequence[float]) -> dict[str, float]:
        information: dict[str, float] = {}
        if self._shares.by_information:
            information = {unit: self._units[unit].information(epoch_ns, variances) for unit in reporting}
        return self._shares.at(reporting, speed_mps, information)

    def forget(self, before_ns: int) -> None:
        """Drop what no epoch will ask for."""
        for unit in self._units.values():
            unit.forget(before_ns)


def _why_not(verdict: Verdict, epoch_ns: int, stale_ns: int) -> str | None:
    """Why a unit does not count at an epoch; None where it does."""
    if verdict.heard_ns is None:
        return "never heard"
    if epoch_ns - verdict.heard_ns > stale_ns:
        return "silent"
    if verdict.gating is not None:
        return verdict.gating
    if verdict.counted_ns is None or epoch_ns - verdict.counted_ns > stale_ns:
        return verdict.refused or "no usable reading"
    return None
