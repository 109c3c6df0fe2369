"""The units of the fuser: when each was heard last, which count, and which an epoch waits for."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from milepost.estimation.observation import Observation
from milepost.estimation.time_units import S_PER_NS
from milepost.fusion.hypotheses import MOTION_MODEL
from milepost.fusion.shares import Shares
from milepost.fusion.verdicts import Verdict

from .unit_record import UnitMemory, UnitRecord, UnitRow
from .working_states import EXCEEDED, GONE, LATE, SILENT, reason_not_in_use

# the variances before the first fused state: all units then have the same information
UNKNOWN = (0.0, 0.0, 0.0)
KEPT_TIMES = 4096
FORGET_EVERY_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Presence:
    """The units at an epoch: ages in seconds and shares of those in use, reasons of the excluded ones.

    `behind_s`: how late the last reading of each excluded unit came that is late.
    """

    ages_s: Mapping[str, float]
    shares: Mapping[str, float]
    excluded: Mapping[str, str]
    behind_s: Mapping[str, float] = field(default_factory=dict)


class Roster:
    """The times of every unit's observations, its missing tokens and its punctuality.

    An epoch waits for a unit whose reading is due and has not come: it is due at the last reading's time + period + latency.
    A unit that missed a deadline is not waited for until one of its readings arrives within `deadline_ns` again.
    """

    def __init__(self, rows: list[UnitRow], shares: Shares, deadline_ns: int) -> None:
        self._units = {row.unit: UnitRecord(row) for row in rows}
        self._shares = shares
        self._deadline_ns = deadline_ns
        self._forgotten_ns = 0

    @property
    def memory(self) -> dict[str, UnitMemory]:
        """What is remembered of the units, but for their tokens."""
        return {name: unit.memory for name, unit in self._units.items()}

    @memory.setter
    def memory(self, other: Mapping[str, UnitMemory]) -> None:
        for name, memory in other.items():
            self._units[name].memory = memory

    @property
    def follows_state(self) -> bool:
        """Whether the shares depend on the fused state."""
        return self._shares.follows_state

    def counted(self, unit: str, measured_at_ns: int) -> None:
        """Note a reading that counts."""
        record = self._units[unit]
        insort(record.times, measured_at_ns)
        if len(record.times) > 2 * KEPT_TIMES:
            del record.times[:KEPT_TIMES]

    def refused(self, unit: str, measured_at_ns: int, why: str, gating: bool = False) -> None:
        """Note a reading that the unit's filter refused; `gating`: as it refuses all for the time being."""
        record = self._units[unit]
        insort(record.refusals, (measured_at_ns, why, gating))
        if len(record.refusals) > 2 * KEPT_TIMES:
            del record.refusals[:KEPT_TIMES]

    def informed(self, unit: str, observation: Observation) -> None:
        """Note the information of a row, if the shares depend on it."""
        if not self._shares.by_information:
            return
        record, R = self._units[unit], observation.variance
        place = bisect_right(record.recent_ns, observation.measured_at_ns)
        record.recent_ns.insert(place, observation.measured_at_ns)
        for column, h in zip(record.recent, observation.row, strict=False):
            column.insert(place, h * h / R)

    def arrived(self, unit: str, measured_at_ns: int, now_ns: int, untimely: bool = False) -> None:
        """Note that a reading arrived, whether or not it counts; `untimely`: too early or too late to be taken."""
        record = self._units[unit]
        record.received_ns, record.behind_ns = now_ns, now_ns - measured_at_ns - record.row.latency_ns
        if untimely:
            return
        record.arrived_ns = max(record.arrived_ns, measured_at_ns)
        if record.behind_ns <= self._deadline_ns:
            record.punctual = True

    def process_alive(self, process: str, alive: bool) -> None:
        """Note a token that appeared or was dropped: a unit needs its sensor and its filter, a balise reader needs `balise`."""
        for name, unit in self._units.items():
            needed = (f"sensor-{name}", f"filter-{name}" if unit.row.fused else "balise")
            if process in needed:
                (unit.gone.discard if alive else unit.gone.add)(process)

    def all_heard(self) -> bool:
        """Whether every unit with a filter has been heard at least once."""
        return all(unit.arrived_ns for unit in self._units.values() if unit.row.fused)

    def expect_from(self, at_ns: int) -> None:
        """After a restart, take every unit as heard at `at_ns`, so that its next reading is due."""
        for unit in self._units.values():
            unit.arrived_ns = max(unit.arrived_ns, at_ns)

    def missing(self, epoch_ns: int) -> list[str]:
        """The units whose reading is due by the epoch and has not come; stale units are excluded instead."""
        out = []
        for name, unit in self._units.items():
            period, last = unit.row.period_ns, unit.arrived_ns
            if period is not None and last and last + period + unit.row.latency_ns <= epoch_ns <= last + unit.stale_ns:
                out.append(name)
        return out

    def awaited(self, missing: list[str]) -> list[str]:
        """The missing units that are punctual and alive: the epoch waits for them."""
        return [name for name in missing if self._units[name].punctual and not self._units[name].gone]

    def missed_deadline(self, unit: str) -> None:
        """Note that an epoch was sent without a unit that it waited for."""
        self._units[unit].punctual = False

    def at(
        self,
        epoch_ns: int,
        live: bool,
        verdicts: Mapping[str, Verdict],
        speed_mps: float = 0.0,
        variances: Sequence[float] = UNKNOWN,
    ) -> Presence:
        """The presence at an epoch by the fuser's `verdicts` and the filters'; shares at a speed and variances of [s, v, a].

        Tokens matter only live: a settled state is a function of the observations.
        """
        ages: dict[str, float] = {}
        excluded: dict[str, str] = {}
        behind: dict[str, float] = {}
        for name, unit in self._units.items():
            if live and unit.gone:
                excluded[name] = GONE
            elif not unit.row.fused:
                reader = verdicts.get(name)
                reason = reader and (reader.kind or reader.refused)
                if reason:
                    excluded[name] = reason
            else:
                verdict = verdicts.get(name) or unit.verdict_at(epoch_ns)
                reason = reason_not_in_use(verdict, epoch_ns, unit.stale_at(speed_mps))
                if reason == SILENT and live:
                    reason = unit.instead_of_silent(epoch_ns)
                if reason is not None:
                    excluded[name] = reason
                elif verdict.counted_ns is not None:
                    ages[name] = (epoch_ns - verdict.counted_ns) * S_PER_NS
                if reason == LATE:
                    behind[name] = unit.behind_ns * S_PER_NS
        motion = verdicts.get(MOTION_MODEL)
        if motion is not None and motion.excluded is not None:
            excluded[MOTION_MODEL] = EXCEEDED
        return Presence(ages, self._shares_of(list(ages), epoch_ns, speed_mps, variances), excluded, behind)

    def _shares_of(self, reporting: list[str], epoch_ns: int, speed_mps: float, variances: Sequence[float]) -> dict[str, float]:
        information: dict[str, float] = {}
        if self._shares.by_information:
            information = {unit: self._units[unit].information(epoch_ns, variances) for unit in reporting}
        return self._shares.at(reporting, speed_mps, information)

    def forget(self, before_ns: int) -> None:
        """Drop what no epoch needs any more, once a second."""
        if before_ns - self._forgotten_ns < FORGET_EVERY_NS:
            return
        self._forgotten_ns = before_ns
        for unit in self._units.values():
            unit.forget(before_ns)
