"""What the tests of the bank decide: hypotheses are refuted, units excluded, and readmitted when they agree again."""

from __future__ import annotations

import numpy as np

from milepost.estimation.beliefs import joined
from milepost.estimation.layout import N_COMMON, Layout

from . import recovery
from .bank_state import Bank, led, likeliest, narrowed, protected, recomposed
from .evidence import Bounds, Flags
from .finding import Finding
from .hypotheses import CHANNELS, MOTION_MODEL, NO_ALTERNATIVES, NOBODY, Doubts, Rows, Units, sources
from .verdicts import Exclusion, Reset, Verdict

# between hypotheses one of which is true, less evidence decides than against all units at once
SOFT = 0.8
# so many compositions of the bank are kept; unbounded, a train whose units lie again and again grows
KEPT_ROWS = 32


class Isolation:
    """The decisions on a bank. `layout` and `doubts` are the train's."""

    def __init__(self, layout: Layout, doubts: Doubts) -> None:
        self._doubts, self._limit = doubts, doubts.threshold
        self._bounds, self._soft_bounds = Bounds(self._limit), Bounds(SOFT * self._limit)
        self._channels = {s.unit: CHANNELS * i for i, s in enumerate(doubts.suspects)}
        self._kept: dict[tuple[Units, frozenset[Units], Units], Rows] = {}
        own = {
            unit: slice(places[N_COMMON], places[-1] + 1) for unit, places in layout.indices.items() if len(places) > N_COMMON
        }
        mean, std = layout.prior(np.zeros(N_COMMON), np.ones(N_COMMON))
        spread = self._limit * np.sqrt(np.diagonal(std))
        self._priors = {unit: (places, mean[places], spread[places]) for unit, places in own.items()}

    def rows(self, excluded: Units, alternatives: frozenset[Units] = NO_ALTERNATIVES, blamed: Units = NOBODY) -> Rows:
        """The rows beside a set of excluded units, the other explanations that are still held, and what was blamed before."""
        # without another explanation nothing depends on the blame
        key = excluded, alternatives, (blamed if alternatives else NOBODY) or excluded
        rows = self._kept.get(key)
        if rows is None:
            if len(self._kept) >= KEPT_ROWS:
                self._kept.clear()
            rows = self._kept[key] = Rows(self._doubts, *key)
        return rows

    def channel(self, unit: str) -> int:
        """The first channel of a unit."""
        return self._channels[unit]

    def decide(self, before: Bank, state: Bank, finding: Finding) -> Bank:
        """Refute hypotheses, and exclude or readmit units; `before`: the bank without the finding's observation."""
        unit, at_ns, uses = finding.unit, finding.at_ns, finding.uses
        far = self._beyond_prior(state, unit)
        finding = finding if far is None else finding._replace(far=far)
        beyond = finding.beyond(self._bounds if state.alive[0] else self._soft_bounds)
        fired = None if beyond is None else uses & beyond & state.alive
        if fired is None or not fired.any():
            if unit in state.rows.excluded:
                state = self._probation(state, finding)
            if MOTION_MODEL in state.rows.excluded:
                state = self._motion_probation(state, at_ns)
            elif not state.alive[0]:
                state = self._motion_blamed(state, finding)
            if state.rows.blamed != state.rows.excluded and at_ns > state.wary_until_ns:
                state = self._settled(state)
            return recovery.revived(state, at_ns) if any(state.dead_ns) and state.alive[0] else state
        alive = state.alive & ~fired
        # where the leading row stands, the evidence is that against the row most refuted
        told = state.leader if fired[state.leader] else int(np.argmax(np.where(fired, finding.worst(), -np.inf)))
        why = self._why(state, finding, told)
        if fired[0] and alive.any():
            # the same noise is in every row: what refuted row 0 need not be found again to the full limit
            soft = alive & uses & (finding.worst() > SOFT * self._limit)
            if (alive & ~soft).any():
                alive = alive & ~soft
        dead = tuple(at_ns if f and not d else d for f, d in zip((~alive).tolist(), state.dead_ns, strict=True))
        if not alive.any():
            return self._restarted(before, unit, why, at_ns)
        state = state._replace(alive=alive, dead_ns=dead)
        if alive[0]:
            return state
        plausible = state.rows.plausible(alive)
        least = state.rows.smallest(plausible)
        if least is not None:
            return self._excluded(before, state, least, why)
        if alive[state.leader]:
            return state
        return led(before, state, likeliest(state, plausible), at_ns, "the hypothesis that led is refuted")

    def _why(self, state: Bank, finding: Finding, row: int, common: float = 0.0) -> Exclusion:
        """The evidence against a row; `common`: for one that does not hear the unit."""
        slips = self._doubts.by_unit[finding.unit].slips
        numbers = float(finding.worst(common)[row]), float(finding.channel.nu[row]), float(state.x[row, 1])
        limit = self._limit if state.alive[0] else SOFT * self._limit
        return Exclusion(finding.at_ns, finding.unit, finding.test(row, common), *numbers, slips, limit)

    def _beyond_prior(self, state: Bank, unit: str) -> Flags | None:
        """The rows where a private state of a unit is farther from its prior than any such device is; None: nowhere."""
        prior = self._priors.get(unit)
        if prior is None:
            return None
        places, mean, reach = prior
        far = np.abs(state.beliefs[places, -1] - mean[:, None]) > reach[:, None]
        return np.asarray(far.any(axis=0)) if np.count_nonzero(far) else None

    def _excluded(self, before: Bank, state: Bank, row: int, why: Exclusion) -> Bank:
        old, units = state.rows, state.rows.sets[row]
        seen = state.innovations(0 if before.alive[0] else row)
        state = led(before, state, row, why.at_ns, "excluded: " + ", ".join(sorted(units - old.excluded)))
        new = self.rows(units, recovery.alternatives(state, units))
        out = recomposed(state, new, sources(new, old, state.alive, lambda s: (s,), row))
        for unit in old.excluded - units:
            # what it was excluded for is explained otherwise
            relapses = max(0, out.verdicts[unit].relapses - 1)
            out = out.judged(unit, out.verdicts[unit]._replace(excluded=None, relapses=relapses))
        if before.alive[0] and why.sudden:
            for unit in units:
                out = self._recalled(before, out, unit, units - old.excluded)
        return self._noted(out, units - old.excluded, why, seen)

    def _recalled(self, before: Bank, state: Bank, unit: str, slipping: Units) -> Bank:
        """A wheel that begins to slip keeps its diameter: each row takes it from the same row that still heard `slipping`.

        What a liar has taught a row so stays in the rows that heard the liar. Without correlation with the common states, which
        never heard the wheel, and of one that begins to slip twice as uncertain as before.
        """
        if unit not in self._priors or not self._doubts.by_unit[unit].slips:
            return state
        B, own = state.beliefs.copy(), self._priors[unit][0]
        more = 4.0 if unit in slipping else 1.0
        for row, units in enumerate(state.rows.sets):
            heard = before.rows.places.get(units - slipping)
            if heard is None:
                continue
            B[own, :, row] = B[:, own, row] = 0.0
            B[own, own, row] = more * before.beliefs[own, own, heard]
            B[own, -1, row] = B[-1, own, row] = before.beliefs[own, -1, heard]
        return state.moved(B)

    def _noted(self, state: Bank, units: Units, why: Exclusion, nu: list[float]) -> Bank:
        """Note why units are excluded, each by its own last innovation `nu` (channels); their tests begin again."""
        verdicts = dict(state.verdicts)
        for unit in units:
            earlier = verdicts[unit]
            own = why
            if unit in self._channels:
                own = why._replace(innovation=nu[self._channels[unit]], slips=self._doubts.by_unit[unit].slips)
            verdicts[unit] = earlier._replace(
                excluded=own, probation_ns=why.at_ns, agreed=0, relapses=earlier.relapses + 1, refused=None
            )
            state = self._fresh(state, unit)
        return state._replace(verdicts=verdicts)

    def _restarted(self, before: Bank, unit: str, why: Exclusion, at_ns: int) -> Bank:
        """No hypothesis is left: go on without the unit that refuted the last one, from the widest belief that was held."""
        old = before.rows
        best = int(np.flatnonzero(before.alive)[0])
        (low, high), (slow, fast) = protected(before)
        units = old.sets[best] | {unit}
        wide = recovery.widened(before, best, self._limit)
        new = self.rows(units)
        out = recomposed(before, new, [best] * len(new.sets))
        out = out._replace(
            beliefs=joined(out.x, np.tile(wide, (len(new.sets), 1, 1))),
            channels=tuple(channel.fresh() for channel in out.channels),
            reset=Reset(at_ns, abs(high - low), abs(fast - slow), "no hypothesis was left: the bank starts again"),
        )
        return self._noted(out, units - old.excluded, why, before.innovations(best))

    def _probation(self, state: Bank, finding: Finding) -> Bank:
        """Readmit an excluded unit that has agreed with the leading hypothesis for long enough.

        Where what is excluded is refuted, all units that this hypothesis hears must have agreed; it is then what is excluded.
        """
        unit, at_ns = finding.unit, finding.at_ns
        if not state.alive[0] and unit in state.rows.sets[state.leader]:
            state = self._heard_again(state, unit, at_ns)
        verdict = state.verdicts[unit].watched(at_ns, float(finding.channel.sums[0, state.leader]))
        earlier = verdict.excluded
        long = earlier is not None and at_ns - earlier.at_ns > recovery.FORGET_NS
        # at first the row is as good as it was with the unit, and a lie that grows would pass for the row's error
        common = finding.common if verdict.relapses > 1 or long else 0.0
        if finding.worst(common)[state.leader] > recovery.disagreement(verdict, SOFT * SOFT * self._limit):
            why = self._why(state, finding, state.leader, common)
            state = self._fresh(state, unit)
            if long and unit in self._priors:
                state = recovery.forgotten(state, ~state.rows.uses(unit), *self._priors[unit], self._limit)
            if earlier is not None and (why.slipping or earlier.found_by != unit) and not earlier.slipping:
                # its own test tells better than another's what it does, and a slip may begin slowly
                verdict = verdict._replace(excluded=why._replace(at_ns=earlier.at_ns))
            return state.judged(unit, verdict._replace(probation_ns=at_ns, agreed=0))
        state = state.judged(unit, verdict := verdict._replace(agreed=verdict.agreed + 1))
        cleared = frozenset((unit,)) if state.alive[0] else state.rows.excluded - state.rows.sets[state.leader]
        if unit not in cleared or not all(
            recovery.passed(state.verdicts[u], self._doubts.by_unit[u].hold, at_ns) for u in cleared
        ):
            return state
        if not state.alive[0] and verdict.excluded is not None:
            return self._excluded(state, state, state.leader, verdict.excluded._replace(at_ns=at_ns))
        counted_ns = at_ns if verdict.refused is None else verdict.counted_ns
        return self._readmitted(state, unit, verdict._replace(agreed=0, counted_ns=counted_ns), at_ns)

    def _heard_again(self, state: Bank, unit: str, at_ns: int) -> Bank:
        """Go on from a row that hears an excluded unit, where it has become the best; all that it hears must agree anew."""
        best = likeliest(state, state.rows.published(state.alive))
        if unit in state.rows.sets[best]:
            return state
        state = led(state, state, best, at_ns, "another hypothesis has become likelier")
        for other in state.rows.excluded - state.rows.sets[best]:
            state = state.judged(other, state.verdicts[other]._replace(probation_ns=at_ns, agreed=0))
        return state

    def _motion_blamed(self, state: Bank, finding: Finding) -> Bank:
        """Hold the motion model exceeded where every other explanation is deaf."""
        plausible, first = state.rows.plausible(state.alive), state.rows.hard.start
        if (plausible & ~state.rows.deaf)[:first].any() or finding.at_ns - state.dead_ns[0] < recovery.PROBATION_NS:
            return state
        best = likeliest(state, plausible)
        return state if best < first else self._excluded(state, state, best, self._why(state, finding, 0))

    def _motion_probation(self, state: Bank, at_ns: int) -> Bank:
        """Take the motion model up again after its probation; where the train still moves harder, it is refuted again."""
        verdict = state.verdicts[MOTION_MODEL]
        over = state.alive[0] and recovery.passed(verdict, 0, at_ns)
        return self._readmitted(state, MOTION_MODEL, verdict, at_ns) if over else state

    def _readmitted(self, state: Bank, unit: str, verdict: Verdict, at_ns: int) -> Bank:
        """Every row continues the one without the unit."""
        old, units = state.rows, state.rows.excluded - {unit}
        new = self.rows(units, recovery.alternatives(state, old.blamed), old.blamed)
        out = recomposed(state, new, recovery.readmitting(state, new, unit))
        out = out._replace(wary_until_ns=at_ns + recovery.WARY_NS)
        return self._fresh(out, unit).judged(unit, verdict._replace(excluded=None, noise=out.verdicts[unit].noise))

    def _settled(self, state: Bank) -> Bank:
        """What was blamed and readmitted is held to have lain and healed: other explanations of that are dropped."""
        old = state.rows
        new = self.rows(old.excluded, frozenset(units for units in old.alternatives if not units >= old.excluded))
        return narrowed(state, new) if old.sets[state.leader] in new.places else state

    def _fresh(self, state: Bank, unit: str) -> Bank:
        """The tests of a unit begin again."""
        place = self._channels.get(unit)
        if place is None:
            return state
        fresh = tuple(channel.fresh() for channel in state.channels[place : place + CHANNELS])
        return state._replace(channels=(*state.channels[:place], *fresh, *state.channels[place + CHANNELS :]))
