"""The bank of hypotheses: the belief without each unit in turn, beside the belief with all, in one timeline."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .evidence import OUT_OF_RANGE, REPEATS, STUCK, SUMS, extended, statistics
from .hypotheses import NOBODY, Doubts, Flags, Rows, Units, sources
from .kalman import KEPT_INTERVALS
from .layout import Array, Layout
from .motion import full_process_noise, full_transition
from .observation import Observation
from .readings import Judge, Linear, linear_rows, said_by
from .verdicts import Exclusion, Reset, Verdict

# a reading may have two rows: the tests of each are apart
CHANNELS = 2
# between hypotheses one of which is true, less evidence decides than against all units at once
SOFT = 0.8
# a refuted hypothesis is taken up again from row 0, if row 0 lives so long
REVIVE_NS = 30_000_000_000
# how long a unit must agree with the others before it counts again: twice as long after each relapse
PROBATION_NS, LONGEST_PROBATION_NS = 1_000_000_000, 64_000_000_000


class Bank(NamedTuple):
    """The kernel's state: H hypotheses over n states, and what was heard of each unit.

    `x` (H, n), `P` (H, n, n); `alive` (H): not refuted; `dead_ns` (H): when refuted; `sums` (H, channels, 6) and `counts`
    (channels) of the tests; `nu` (H, channels): the last innovations. `leader`: the row that is published. `since_ns`: the time of the first observation that counted.
    """

    rows: Rows
    x: Array
    P: Array
    alive: Flags
    dead_ns: tuple[int, ...]
    sums: Array
    counts: tuple[int, ...]
    strikes: tuple[int, ...]
    nu: Array
    verdicts: Mapping[str, Verdict]
    leader: int = 0
    since_ns: int | None = None
    reset: Reset | None = None

    @property
    def doubted(self) -> tuple[str, ...]:
        """The units of which one lies, while nothing tells which."""
        if self.alive[0]:
            return ()
        plausible = self.rows.plausible(self.alive)
        sets = [units - self.rows.excluded for units, held in zip(self.rows.sets, plausible, strict=True) if held]
        return tuple(sorted(frozenset().union(*sets)))


class BankKernel:
    """The two steps of a timeline over all hypotheses at once; a hypothesis takes nothing from the units that it leaves out.

    So the belief without a unit never heard it, and excluding the unit is choosing another row: exact, whenever it began to
    lie. Each hypothesis linearises at its own belief.
    """

    def __init__(self, layout: Layout, jerk_psd: float, judges: Mapping[str, Judge], doubts: Doubts) -> None:
        self.layout, self.jerk_psd, self.doubts = layout, jerk_psd, doubts
        self._judges = judges
        self._limit = doubts.threshold
        self._channels = {s.unit: CHANNELS * i for i, s in enumerate(doubts.suspects)}
        self._steps: dict[float, tuple[Array, Array]] = {}
        self._kept: dict[Units, Rows] = {}
        self._prior_mean = np.array([state.prior_mean for state in layout.private])
        self._prior_std = np.array([max(state.prior_std, 1e-300) for state in layout.private])

    # --- beliefs in and out

    def prior(self, mean: Array, covariance: Array) -> Bank:
        """The prior before the first observation."""
        return self._begin(mean, covariance, {u: Verdict(j.start()) for u, j in self._judges.items()}, None)

    def pack(self, mean: Array, covariance: Array) -> Bank:
        """A belief on a running train: every hypothesis starts from it; the judges restart with an empty memory."""
        return self._begin(mean, covariance, {u: Verdict(j.restart()) for u, j in self._judges.items()}, 0)

    def _begin(self, mean: Array, covariance: Array, verdicts: dict[str, Verdict], since_ns: int | None) -> Bank:
        for suspect in self.doubts.suspects:
            verdicts.setdefault(suspect.unit, Verdict(None))
        rows = self._rows(NOBODY)
        H, channels = len(rows.sets), CHANNELS * len(self.doubts.suspects)
        x = np.tile(np.asarray(mean, dtype=float), (H, 1))
        P = np.tile(np.asarray(covariance, dtype=float), (H, 1, 1))
        zeros = np.zeros((H, channels, SUMS))
        counts = (0,) * channels
        return Bank(rows, x, P, np.ones(H, dtype=bool), (0,) * H, zeros, counts, (0,) * H, zeros[:, :, 0], verdicts, since_ns=since_ns)

    def unpack(self, state: Bank) -> tuple[Array, Array]:
        """The mean (n) and covariance (n, n) of the leading hypothesis."""
        return state.x[state.leader], state.P[state.leader]

    def lists(self, state: Bank) -> tuple[list[float], list[list[float]]]:
        """The same as lists, for messages."""
        return state.x[state.leader].tolist(), state.P[state.leader].tolist()

    def _rows(self, excluded: Units) -> Rows:
        rows = self._kept.get(excluded)
        if rows is None:
            rows = self._kept[excluded] = Rows(self.doubts, excluded)
        return rows

    # --- the two steps

    def advance(self, state: Bank, dt_s: float) -> Bank:
        """All hypotheses `dt_s` seconds later."""
        if state.since_ns is None:
            return state
        step = self._steps.get(dt_s)
        if step is None:
            if len(self._steps) >= KEPT_INTERVALS:
                self._steps.clear()
            step = full_transition(dt_s, self.layout), full_process_noise(dt_s, self.jerk_psd, self.layout)
            self._steps[dt_s] = step
        F, Q = step
        return state._replace(x=state.x @ F.T, P=F @ state.P @ F.T + Q)

    def take(self, state: Bank, observation: Observation) -> Bank:
        """All hypotheses after one observation, or after a whole reading."""
        unit, at_ns = observation.unit, observation.measured_at_ns
        state = self._repeated(state, observation)
        if observation.reading is None:
            row = Linear(np.array(observation.row), observation.value, observation.variance)
            return self._counted(self._observe(state, unit, 0, row, at_ns), unit, at_ns)
        before = state.verdicts[unit]
        rows, memory, gating, refused = linear_rows(self._judges[unit], self.layout, unit, before.memory, observation, state)
        heard = before._replace(memory=memory, heard_ns=at_ns, gating=gating, refused=refused)
        state = state._replace(verdicts={**state.verdicts, unit: heard})
        for component, row in enumerate(rows):
            state = self._observe(state, unit, min(component, CHANNELS - 1), row, at_ns)
        return self._counted(state, unit, at_ns) if rows else state

    def _repeated(self, state: Bank, observation: Observation) -> Bank:
        suspect = self.doubts.by_unit.get(observation.unit)
        if suspect is None or not suspect.never_repeats:
            return state
        said, verdict = said_by(observation), state.verdicts[observation.unit]
        repeats = verdict.repeats + 1 if said is not None and said == verdict.said else 0
        return state._replace(verdicts={**state.verdicts, observation.unit: verdict._replace(said=said, repeats=repeats)})

    def _counted(self, state: Bank, unit: str, at_ns: int) -> Bank:
        since_ns = at_ns if state.since_ns is None else state.since_ns
        verdict = state.verdicts.get(unit, Verdict(None))._replace(heard_ns=at_ns)
        if unit not in state.rows.excluded and verdict.refused is None:
            verdict = verdict._replace(counted_ns=at_ns)
        return state._replace(since_ns=since_ns, verdicts={**state.verdicts, unit: verdict})

    def _observe(self, state: Bank, unit: str, component: int, row: Linear, at_ns: int) -> Bank:
        """Test one scalar observation against every hypothesis, and update those that use the unit."""
        x, P, h = state.x, state.P, row.h
        if h.ndim == 1:
            g = P @ h
            S, nu = g @ h + row.R, row.z - x @ h
        else:
            g = (P @ h[:, :, None])[:, :, 0]
            S, nu = (g * h).sum(axis=1) + row.R, row.z - (x * h).sum(axis=1)
        uses = state.rows.uses(unit)
        if row.present is not None:
            uses = uses & row.present
        place = self._channels.get(unit)
        if place is None:
            return state._replace(**_updated(x, P, h, g, S, nu, row.R, uses))
        channel = place + component
        e = nu / np.sqrt(S)
        if row.present is not None:
            e = np.where(row.present, e, 0.0)
        suspect, strikes = self.doubts.by_unit[unit], state.strikes
        taken, counted = uses, e
        if suspect.odd_alone:
            odd = np.abs(e) > self._limit
            taken, counted = uses & ~odd, np.where(uses & odd, 0.0, e)
            strikes = tuple(
                (s + 1 if o else 0) if u else s for s, o, u in zip(strikes, odd.tolist(), uses.tolist(), strict=True)
            )
        innovations, sums, counts = state.nu.copy(), state.sums.copy(), list(state.counts)
        innovations[:, channel] = nu
        sums[:, channel] = extended(sums[:, channel], counted)
        counts[channel] += 1
        tests = statistics(sums[:, channel], counted, counts[channel])
        worst = tests.max(axis=1)
        if suspect.odd_alone:
            worst = np.where(np.array(strikes) >= 2, np.maximum(worst, 2.0 * self._limit), worst)
        verdicts = state.verdicts
        if suspect.odd_alone:
            refused = "does not fit" if bool(odd[state.leader]) else None
            verdicts = {**verdicts, unit: verdicts[unit]._replace(refused=refused)}
        before = state
        after = state._replace(
            **_updated(x, P, h, g, S, nu, row.R, taken),
            sums=sums,
            counts=tuple(counts),
            strikes=strikes,
            nu=innovations,
            verdicts=verdicts,
        )
        return self._judged(before, after, unit, channel, uses, worst, tests, e, nu, at_ns)

    # --- what the tests decide

    def _judged(
        self,
        before: Bank,
        state: Bank,
        unit: str,
        channel: int,
        uses: Flags,
        worst: Array,
        tests: Array,
        e: Array,
        nu: Array,
        at_ns: int,
    ) -> Bank:
        """Refute hypotheses, and exclude or readmit units."""
        limit = self._limit if state.alive[0] else SOFT * self._limit
        stuck, far = state.verdicts[unit].repeats >= REPEATS, self._beyond_prior(state, unit)
        beyond = (worst > limit) | far | stuck
        if stuck:
            worst = np.full_like(worst, np.inf)
        fired = uses & beyond & state.alive
        if not fired.any():
            state = self._probation(state, unit, worst, self._why(state, unit, tests, worst, nu, stuck, far, at_ns), at_ns)
            return self._revived(state, at_ns) if any(state.dead_ns) and state.alive[0] else state
        alive = state.alive & ~fired
        if fired[0] and alive.any():
            # the same noise is in every row: what refuted row 0 need not be found again to the full limit
            soft = alive & uses & (worst > SOFT * self._limit)
            if (alive & ~soft).any():
                alive = alive & ~soft
        dead = tuple(at_ns if f and not d else d for f, d in zip((~alive).tolist(), state.dead_ns, strict=True))
        why = self._why(state, unit, tests, worst, nu, stuck, far, at_ns)
        if not alive.any():
            return self._restarted(before, state, unit, why, at_ns)
        state = state._replace(alive=alive, dead_ns=dead)
        if alive[0]:
            return state
        plausible = state.rows.plausible(alive)
        least = state.rows.smallest(plausible)
        if least is not None:
            return self._excluded(state, least, why, at_ns)
        if not alive[state.leader]:
            # the odds of each by its probability and the worst that its own units say against it
            odds = np.log(state.rows.chances) - 0.5 * self._margins(state) ** 2
            best = int(np.argmax(np.where(plausible, odds, -np.inf)))
            return _led(state, best, at_ns, "the hypothesis that led is refuted")
        return state

    def _why(
        self, state: Bank, unit: str, tests: Array, worst: Array, nu: Array, stuck: bool, far: Flags, at_ns: int
    ) -> Exclusion:
        lead = state.leader
        test = STUCK if stuck else OUT_OF_RANGE if far[lead] else int(np.argmax(tests[lead]))
        slips = self.doubts.by_unit[unit].slips
        return Exclusion(at_ns, unit, test, float(worst[lead]), float(nu[lead]), float(state.x[lead, 1]), slips)

    def _beyond_prior(self, state: Bank, unit: str) -> Flags:
        """Whether a private state of a unit is farther from its prior than any such device is."""
        places = self.layout.indices.get(unit)
        if places is None:
            return np.zeros(len(state.x), dtype=bool)
        own = [p for p in places if p >= 3]
        off = np.abs(state.x[:, own] - self._prior_mean[[p - 3 for p in own]])
        return np.asarray((off > self._limit * self._prior_std[[p - 3 for p in own]]).any(axis=1))

    def _margins(self, state: Bank) -> Array:
        """Each row's worst test over all units that it uses."""
        out = np.zeros(len(state.x))
        for unit, place in self._channels.items():
            uses = state.rows.uses(unit)
            for channel in range(place, place + CHANNELS):
                if state.counts[channel]:
                    tests = statistics(state.sums[:, channel], np.zeros(len(out)), state.counts[channel])
                    out = np.maximum(out, np.where(uses, tests.max(axis=1), 0.0))
        return out

    def _excluded(self, state: Bank, row: int, why: Exclusion, at_ns: int) -> Bank:
        old, units = state.rows, state.rows.sets[row]
        state = _led(state, row, at_ns, "excluded: " + ", ".join(sorted(units - old.excluded)))
        new = self._rows(units)
        out = _recomposed(state, new, sources(new, old, state.alive, lambda s: (s,), row))
        return self._noted(out, units - old.excluded, why)

    def _noted(self, state: Bank, units: Units, why: Exclusion) -> Bank:
        """Note why units are excluded, each by what it did itself; their tests begin again, on probation."""
        verdicts = dict(state.verdicts)
        for unit in units:
            earlier, slips = verdicts[unit], self.doubts.by_unit[unit].slips
            own = why._replace(innovation=float(state.nu[state.leader, self._channels[unit]]), slips=slips)
            verdicts[unit] = earlier._replace(
                excluded=own, probation_ns=why.at_ns, agreed=0, relapses=earlier.relapses + 1, refused=None
            )
            state = self._fresh(state, unit)
        return state._replace(verdicts=verdicts)

    def _restarted(self, before: Bank, state: Bank, unit: str, why: Exclusion, at_ns: int) -> Bank:
        """No hypothesis is left: go on without the unit that refuted the last one, from the widest belief that was held."""
        old = before.rows
        best = int(np.flatnonzero(before.alive)[0])
        low, high = protected(before, 0)
        slow, fast = protected(before, 1)
        units = old.sets[best] | {unit}
        wide = before.P[best].copy()
        for place, half in ((0, 0.5 * (high - low)), (1, 0.5 * (fast - slow))):
            factor = max(1.0, (half / self._limit) ** 2 / max(wide[place, place], 1e-300)) ** 0.5
            wide[place] *= factor
            wide[:, place] *= factor
        new = self._rows(units)
        out = _recomposed(before, new, [best] * len(new.sets))
        out = out._replace(
            P=np.tile(wide, (len(new.sets), 1, 1)),
            sums=np.zeros_like(out.sums),
            counts=(0,) * len(out.counts),
            reset=Reset(at_ns, abs(high - low), abs(fast - slow), "no hypothesis was left: the bank starts again"),
        )
        return self._noted(out, units - old.excluded, why)

    def _probation(self, state: Bank, unit: str, worst: Array, why: Exclusion, at_ns: int) -> Bank:
        """Readmit an excluded unit that has agreed with the leading hypothesis for long enough."""
        if unit not in state.rows.excluded:
            return state
        verdict, suspect = state.verdicts[unit], self.doubts.by_unit[unit]
        if worst[state.leader] > SOFT * SOFT * self._limit:
            state = self._fresh(state, unit)
            earlier = verdict.excluded
            if earlier is not None and (why.slipping or earlier.found_by != unit) and not earlier.slipping:
                # its own test tells better than another's what it does, and a slip may begin slowly
                verdict = verdict._replace(excluded=why._replace(at_ns=earlier.at_ns))
            return state._replace(verdicts={**state.verdicts, unit: verdict._replace(probation_ns=at_ns, agreed=0)})
        agreed = verdict.agreed + 1
        hold_ns = min(LONGEST_PROBATION_NS, PROBATION_NS << min(verdict.relapses - 1, 10))
        if agreed < suspect.hold or at_ns - verdict.probation_ns < hold_ns or not state.alive[0]:
            return state._replace(verdicts={**state.verdicts, unit: verdict._replace(agreed=agreed)})
        old = state.rows
        new = self._rows(old.excluded - {unit})
        out = _recomposed(state, new, sources(new, old, state.alive, lambda s: (s | {unit},), state.leader))
        out = self._fresh(out, unit)
        return out._replace(verdicts={**out.verdicts, unit: verdict._replace(excluded=None, agreed=0)})

    def _fresh(self, state: Bank, unit: str) -> Bank:
        """The tests of a unit begin again."""
        place = self._channels[unit]
        sums, counts = state.sums.copy(), list(state.counts)
        sums[:, place : place + CHANNELS] = 0.0
        counts[place : place + CHANNELS] = [0] * CHANNELS
        return state._replace(sums=sums, counts=tuple(counts), strikes=(0,) * len(state.strikes))

    def _revived(self, state: Bank, at_ns: int) -> Bank:
        due = [bool(d) and at_ns - d > REVIVE_NS for d in state.dead_ns]
        if not any(due):
            return state
        index = [0 if d else i for i, d in enumerate(due)]
        dead = tuple(0 if d else ns for d, ns in zip(due, state.dead_ns, strict=True))
        return state._replace(
            x=state.x[index], P=state.P[index], sums=state.sums[index], nu=state.nu[index], alive=state.alive | np.array(due), dead_ns=dead
        )


def _updated(x: Array, P: Array, h: Array, g: Array, S: Array, nu: Array, R: Any, taken: Flags) -> dict[str, Array]:
    """x, P after the update in Joseph's form (see `kalman.update`), with gain 0 in the rows that do not take it."""
    K = np.where(taken, 1.0 / S, 0.0)[:, None] * g
    A = P - K[:, :, None] * g[:, None, :]
    Ah = A @ h if h.ndim == 1 else (A @ h[:, :, None])[:, :, 0]
    B = (R if isinstance(R, float) else R[:, None]) * K - Ah
    new = A + B[:, :, None] * K[:, None, :]
    return {"x": x + K * nu[:, None], "P": 0.5 * (new + new.transpose(0, 2, 1))}


def _recomposed(state: Bank, rows: Rows, index: list[int]) -> Bank:
    """The bank with other rows, each the continuation of the old row `index`."""
    H = len(rows.sets)
    return state._replace(
        rows=rows,
        x=state.x[index],
        P=state.P[index],
        sums=state.sums[index],
        nu=state.nu[index],
        strikes=(0,) * H,
        alive=np.ones(H, dtype=bool),
        dead_ns=(0,) * H,
        leader=0,
    )


def _led(state: Bank, row: int, at_ns: int, reason: str) -> Bank:
    """Another row leads; a step that is larger than the new row's own uncertainty is noted."""
    old, new = state.x[state.leader], state.x[row]
    step_m, step_mps = float(new[0] - old[0]), float(new[1] - old[1])
    variances = np.diagonal(state.P[row])
    far = abs(step_m) > 2.0 * math.sqrt(variances[0]) or abs(step_mps) > 2.0 * math.sqrt(variances[1])
    return state._replace(leader=row, reset=Reset(at_ns, step_m, step_mps, reason) if far else state.reset)


def protected(state: Bank, place: int) -> tuple[float, float]:
    """[min, max] of the state at `place` over the hypotheses that are not refuted: the union of x_h ± K_h σ_h."""
    held = state.rows.published(state.alive)
    reach = state.rows.reach(state.alive)[held] * np.sqrt(state.P[held, place, place])
    centre = state.x[held, place]
    return float((centre - reach).min()), float((centre + reach).max())
