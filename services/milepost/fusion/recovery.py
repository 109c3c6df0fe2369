"""How rows, units and the bank itself come back: what is taken up again, from what, and after how long."""

from __future__ import annotations

from functools import lru_cache
from statistics import NormalDist

import numpy as np

from milepost.estimation.layout import Array

from .bank_state import Bank, protected
from .evidence import Flags
from .hypotheses import MOTION_MODEL, Rows, Units, sources
from .verdicts import Verdict

# a refuted hypothesis is taken up again from row 0, if row 0 lives so long
REVIVE_NS = 30_000_000_000
# a unit that has been wrong for so long is given its prior again: it may have learned its own lie
FORGET_NS = 30_000_000_000
# how long a unit must agree with the others before it counts again: twice as long after each relapse
PROBATION_NS, LONGEST_PROBATION_NS = 1_000_000_000, 64_000_000_000
# for so long after a unit was readmitted it is held possible that it never lay, but two others do, unseen
WARY_NS = 60_000_000_000


def revived(state: Bank, at_ns: int) -> Bank:
    """Refuted rows go on from row 0 again after a while; what is refuted as an alternative stays so."""
    rows = state.rows
    due = [bool(d) and at_ns - d > REVIVE_NS and s >= rows.excluded for d, s in zip(state.dead_ns, rows.sets, strict=True)]
    if not any(due):
        return state
    index = [0 if d else i for i, d in enumerate(due)]
    dead = tuple(0 if d else ns for d, ns in zip(due, state.dead_ns, strict=True))
    return state.of(index)._replace(alive=state.alive | np.array(due), dead_ns=dead)


def hold_ns(verdict: Verdict) -> int:
    """How long the unit must agree."""
    return min(LONGEST_PROBATION_NS, PROBATION_NS << min(max(0, verdict.relapses - 1), 10))


def passed(verdict: Verdict, hold: int, at_ns: int) -> bool:
    """Whether a unit has agreed for long enough, with so many readings at least."""
    return verdict.agreed >= hold and at_ns - verdict.probation_ns >= hold_ns(verdict)


def disagreement(verdict: Verdict, limit: float) -> float:
    """The deviate above which a reading speaks against a unit on probation: `limit` in the shortest one.

    In one that is m times as long, that whose probability is m times smaller: noise begins a long one anew no more often.
    """
    return _rarer(limit, hold_ns(verdict) // PROBATION_NS)


@lru_cache(maxsize=64)
def _rarer(limit: float, times: int) -> float:
    normal = NormalDist()
    return limit if times == 1 else -normal.inv_cdf(normal.cdf(-limit) / times)


def forgotten(state: Bank, rows: Flags, places: slice, mean: Array, reach: Array, limit: float) -> Bank:
    """What these rows know of a unit is its prior again: one that is wrong for so long may have been taught so.

    Its prior is `mean` (k) ± `reach` (k), which is `limit` σ.
    """
    B, those = state.beliefs.copy(), state.beliefs[:, :, rows]
    those[places] = those[:, places] = 0.0
    those[places, places] = np.diag((reach / limit) ** 2)[:, :, None]
    those[places, -1] = those[-1, places] = mean[:, None]
    B[:, :, rows] = those
    return state.moved(B)


def alternatives(state: Bank, blamed: Units) -> frozenset[Units]:
    """The rows alive that explain otherwise why units are, or were, excluded.

    Where the train moves harder than its motion model, only those that hear a unit which reads the speed: others are never
    refuted, and their intervals grow without end.
    """
    alive = (units for units, lives in zip(state.rows.sets, state.alive, strict=True) if lives)
    others = frozenset(units for units in alive if not units >= blamed)
    if MOTION_MODEL not in blamed:
        return others
    return frozenset(units for units in others if state.rows.doubts.speed_units - units)


def readmitting(state: Bank, new: Rows, unit: str) -> list[int]:
    """For each row once a unit is readmitted, the row that it continues: the one without the unit.

    A row that never left the unit out explains otherwise why it was excluded: it goes on by itself. A row of several causes
    that hears neither speed nor position knows nothing, and is not continued: its causes begin now, from the leading row.
    """
    old = state.rows

    def wanted(units: Units) -> tuple[Units, ...]:
        without = units | {unit}
        several = not new.near[new.places[units]]
        return (units,) if several and without in old.places and old.deaf[old.places[without]] else (units, without)

    return sources(new, old, state.alive, wanted, state.leader)


def widened(state: Bank, row: int, limit: float) -> Array:
    """The covariance (n, n) of a row, scaled so that `limit` σ of position and of speed reach over the published interval."""
    x = state.x[row]
    P: Array = state.P[row].copy()
    for place, (low, high) in enumerate(protected(state)):
        reach = max(high - x[place], x[place] - low)
        factor = max(1.0, (reach / limit) ** 2 / max(P[place, place], 1e-300)) ** 0.5
        P[place] *= factor
        P[:, place] *= factor
    return P
