"""The bank of hypotheses: the belief without each unit in turn, beside the belief with all, in one timeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from milepost.estimation.beliefs import joined
from milepost.estimation.layout import N_COMMON, Array, Layout
from milepost.estimation.observation import Observation
from milepost.estimation.stack import Linear, Motion, Stack

from .bank_state import Bank, Channel
from .evidence import REPEATS, Flags, extended
from .finding import Finding
from .hypotheses import CHANNELS, MOTION_MODEL, NOBODY, Doubts, Rows, Units
from .isolation import Isolation
from .readings import Judge, Readings, dense, said_by
from .verdicts import Verdict

NEVER_HEARD = Verdict(None)
# so many refused fixes are remembered
KEPT_ODD = 32


class BankKernel:
    """The two steps of a timeline over all hypotheses at once; a hypothesis takes nothing from the units that it leaves out.

    So the belief without a unit never heard it, and excluding the unit is choosing another row: exact, whenever it began to
    lie. Each hypothesis linearises at its own belief.
    """

    def __init__(self, layout: Layout, jerk_psd: float, judges: Mapping[str, Judge], doubts: Doubts, horizon_s: float) -> None:
        self.layout, self.jerk_psd, self.doubts = layout, jerk_psd, doubts
        self._judges, self._readings = judges, Readings(layout, judges)
        self._isolation = Isolation(layout, doubts)
        self._stack = Stack()
        self._motion = Motion(layout, jerk_psd, max(0.0, doubts.hard_jerk_psd - jerk_psd))
        self._horizon_s = horizon_s
        self._prior = np.zeros(layout.dimension), np.eye(layout.dimension)

    # --- beliefs in and out

    def prior(self, mean: Array, covariance: Array) -> Bank:
        """The prior before the first observation."""
        self._prior = mean, covariance
        return self._begin(mean, covariance, {u: Verdict(j.start()) for u, j in self._judges.items()}, None)

    def pack(self, mean: Array, covariance: Array) -> Bank:
        """A belief on a running train: every hypothesis starts from it; the judges restart with an empty memory."""
        return self._begin(mean, covariance, {u: Verdict(j.restart()) for u, j in self._judges.items()}, 0)

    def _begin(self, mean: Array, covariance: Array, verdicts: dict[str, Verdict], since_ns: int | None) -> Bank:
        for unit in (*self.doubts.by_unit, MOTION_MODEL):
            verdicts.setdefault(unit, NEVER_HEARD)
        rows = self._isolation.rows(NOBODY)
        H, channels = len(rows.sets), CHANNELS * len(self.doubts.suspects)
        return Bank(
            joined(np.tile(mean, (H, 1)), np.tile(covariance, (H, 1, 1))),
            (Channel.begin(H),) * channels,
            verdicts,
            rows,
            alive=np.ones(H, dtype=bool),
            dead_ns=(0,) * H,
            since_ns=since_ns,
            waiting=np.ones(H, dtype=bool) if since_ns is None else None,
        )

    def rows(self, excluded: Units, alternatives: frozenset[Units], blamed: Units) -> Rows:
        """The rows that follow from what is excluded, what explains it otherwise, and what was blamed."""
        return self._isolation.rows(excluded, alternatives, blamed)

    def unpack(self, state: Bank) -> tuple[Array, Array]:
        """The mean (n) and covariance (n, n) of the leading hypothesis."""
        return state.x[state.leader], state.P[state.leader]

    def lists(self, state: Bank) -> tuple[list[float], list[list[float]]]:
        """The same as lists, for messages."""
        return state.x[state.leader].tolist(), state.P[state.leader].tolist()

    # --- the two steps

    def advance(self, state: Bank, dt_s: float) -> Bank:
        """All hypotheses `dt_s` seconds later."""
        if state.since_ns is None:
            return state
        step = self._motion.over(dt_s)
        B = self._stack.predict(state.beliefs, step)
        if state.rows.hard:
            # the rows of a train that moves harder
            B[:N_COMMON, :N_COMMON, state.rows.hard.start :] += step.harder
        state = state.moved(B)
        return state if state.waiting is None else self._waited(state, dt_s)

    def _waited(self, state: Bank, dt_s: float) -> Bank:
        """Rows that wait for one of their units are where the train would be if the first reading of all was in time.

        Beyond the horizon no clock that is behind can be taken for the first reading.
        """
        waited_s = state.waited_s + dt_s
        return state._replace(waiting=state.waiting if waited_s <= self._horizon_s else None, waited_s=waited_s)

    def _begun(self, state: Bank, begins: Flags) -> Bank:
        """The prior, with P_ss + (v t)², for rows that begin the time t after the first reading of all.

        The prior is that at the first reading: if that one came from a clock that is behind, the train has not moved since.
        """
        (mean, covariance), B = self._prior, state.beliefs.copy()
        B[:, :, begins] = joined(mean[None], covariance[None])
        B[0, 0, begins] += (mean[1] * state.waited_s) ** 2
        return state.moved(B)

    def take(self, state: Bank, observation: Observation) -> Bank:
        """All hypotheses after one observation, or after a whole reading."""
        unit, at_ns = observation.unit, observation.measured_at_ns
        verdict = state.verdicts.get(unit, NEVER_HEARD)
        memory, gating, refused = verdict.memory, verdict.gating, verdict.refused
        if observation.reading is None:
            rows: Sequence[Linear] = (Linear(dense(observation.row), observation.value, observation.variance),)
        else:
            rows, memory, gating, refused = self._readings.rows(memory, observation, state.beliefs, state.leader)
        suspect = self.doubts.by_unit.get(unit)
        # an odd reading is judged below; and where a decision excludes the unit, nobody asks what counted
        counts = refused is None and unit not in state.rows.excluded and not (suspect and suspect.odd_alone)
        counted_ns = at_ns if counts else verdict.counted_ns
        said = said_by(observation) if suspect and suspect.never_repeats else None
        state = state.judged(unit, verdict.told(said, memory, at_ns, counted_ns, gating, refused))
        if rows and state.waiting is not None and (begins := state.waiting & state.rows.uses(unit)).any():
            state = self._begun(state, begins)
        learns = observation.reading is not None and unit in self._readings.learners
        for component, row in enumerate(rows):
            if learns:
                verdict = state.verdicts[unit]
                row, verdict = self._readings.learned(unit, component, row, verdict, state.beliefs, at_ns)
                state = state.judged(unit, verdict)
            state = self._observe(state, unit, min(component, CHANNELS - 1), row, at_ns)
        if rows and state.waiting is not None:
            waiting = state.waiting & ~state.rows.uses(unit)
            since_ns = at_ns if state.since_ns is None else state.since_ns
            # a row that leads is taken to move as the others do
            goes_on = waiting.any() and not waiting[state.leader]
            state = state._replace(since_ns=since_ns, waiting=waiting if goes_on else None)
        return state

    def _observe(self, state: Bank, unit: str, component: int, row: Linear, at_ns: int) -> Bank:
        """Test one scalar observation against every hypothesis, and update those that use the unit."""
        innovations, present = self._stack.innovations(state.beliefs, row), row.present
        uses, scale = state.rows.uses(unit), self.layout.scales.get(unit)
        if present is not None:
            uses = uses & present
        suspect = self.doubts.by_unit.get(unit)
        if suspect is None:
            return state.moved(self._stack.update(state.beliefs, row, innovations, uses, scale))
        e = innovations.nu / innovations.root
        if present is not None:
            e = np.where(present, e, 0.0)
        odd = uses & (np.abs(e) > self.doubts.threshold) if suspect.odd_alone else None
        place = self._isolation.channel(unit) + component
        heard = _tested(state.channels[place], e, innovations.nu, odd)
        taken = uses if odd is None else uses & ~odd
        after = state.tested(self._stack.update(state.beliefs, row, innovations, taken, scale), place, heard)
        struck = None
        if odd is not None:
            against = _contradicted(state, taken)
            struck = (heard.strikes >= 2) | (odd & against)
            after = after.judged(unit, _alone(state, unit, bool((odd & ~against)[state.leader]), at_ns))
        stuck = state.verdicts[unit].repeats >= REPEATS
        common = 0.0
        if unit in state.rows.excluded:
            common = 1.0 - float((row.R / innovations.S)[state.leader])
        return self._isolation.decide(state, after, Finding(unit, at_ns, uses, heard, struck, stuck, common=common))


def _contradicted(state: Bank, fits: Flags) -> Flags:
    """The rows (H) against which a single odd fix is evidence, because it `fits` (H) another explanation of what was seen.

    While others are in doubt these are all rows. Once units are excluded, they are the rows that explain the exclusion
    otherwise, by several causes: if the fix were wrong too, it would need one more.
    """
    if state.alive[0]:
        return np.asarray(state.rows.several & fits[0])
    return np.full(len(fits), bool((state.alive & fits).any()))


def _alone(state: Bank, unit: str, odd: bool, at_ns: int) -> Verdict:
    """The verdict on a unit whose readings are refused one by one, after one that is `odd` to the leading hypothesis or not."""
    verdict = state.verdicts[unit]
    if odd:
        return verdict._replace(refused="does not fit", odd_ns=(*verdict.odd_ns[-KEPT_ODD:], at_ns))
    return verdict._replace(refused=None, counted_ns=verdict.counted_ns if unit in state.rows.excluded else at_ns)


def _tested(channel: Channel, e: Array, nu: Array, odd: Flags | None) -> Channel:
    """A channel after the normalised innovations e (H) and the innovations nu (H).

    `odd` (H): where one reading by itself is refused: it does not enter the sums, and the second in a row tells against the
    unit.
    """
    if odd is None:
        return Channel(extended(channel.sums, e), channel.readings + 1, nu, channel.strikes)
    return Channel(extended(channel.sums, np.where(odd, 0.0, e)), channel.readings + 1, nu, channel.strikes).struck(odd)
