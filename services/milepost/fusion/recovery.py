"""How rows, units and the bank itself come back: what is taken up again, from what, and after how long."""

from __future__ import annotations

import numpy as np

from milepost.estimation.layout import Array

from .bank_state import Bank, protected
from .evidence import M, statistics, window_of
from .finding import Finding
from .hypotheses import MOTION_MODEL, NO_ALTERNATIVES, Suspect, Units
from .verdicts import Verdict

# a refuted hypothesis is taken up again from row 0, if row 0 lives so long
REVIVE_NS = 30_000_000_000
# how long a unit must agree with the others before it counts again: twice as long after each relapse
PROBATION_NS, LONGEST_PROBATION_NS = 1_000_000_000, 64_000_000_000
# a unit that agrees has means within so many σ, over as many readings as told that it did not: at most so many, and so long
CLOSE, LONGEST_HOLD, LONGEST_HOLD_S = 2.0, 64, 7.0


def revived(state: Bank, at_ns: int) -> Bank:
    """Refuted rows go on from row 0 again after a while; what is refuted as an alternative stays so."""
    rows = state.rows
    due = [bool(d) and at_ns - d > REVIVE_NS and s >= rows.excluded for d, s in zip(state.dead_ns, rows.sets, strict=True)]
    if not any(due):
        return state
    index = [0 if d else i for i, d in enumerate(due)]
    dead = tuple(0 if d else ns for d, ns in zip(due, state.dead_ns, strict=True))
    return state.of(index)._replace(
        alive=state.alive | np.array(due),
        dead_ns=dead,
    )


def hold_ns(verdict: Verdict) -> int:
    """How long the unit must agree."""
    return min(LONGEST_PROBATION_NS, PROBATION_NS << min(max(0, verdict.relapses - 1), 10))


def agrees_closely(finding: Finding, row: int, verdict: Verdict, suspect: Suspect) -> bool:
    """Whether the unit of a finding agrees with a row as closely, and for as many readings, as told that it did not.

    A weak liar's mean leaves `CLOSE` σ long before it refutes anything; by itself it would be readmitted and found again.
    """
    told = 0 if verdict.excluded is None else window_of(verdict.excluded.test)
    needed = max(suspect.hold, min(told, LONGEST_HOLD, int(LONGEST_HOLD_S * suspect.readings_per_s)))
    if verdict.agreed + 1 < needed:
        return False
    return bool(statistics(finding.channel.sums, finding.channel.readings)[1:M, row].max() <= CLOSE)


def alternatives(state: Bank, excluded: Units) -> frozenset[Units]:
    """The rows alive of a train that moves harder, which explain otherwise why units are excluded."""
    if MOTION_MODEL in excluded:
        return NO_ALTERNATIVES
    held = (state.rows.sets[i] for i in state.rows.hard if state.alive[i])
    return frozenset(units for units in held if not units >= excluded)


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
