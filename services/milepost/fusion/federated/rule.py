"""The rule `federated`: the sources' weighted mean of the filters' beliefs."""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from milepost.estimation.estimator import Prior, kernel_for
from milepost.estimation.kalman import update
from milepost.estimation.kept import Counters, Kept
from milepost.estimation.layout import COMMON, Array, Layout
from milepost.estimation.motion import transition
from milepost.estimation.observation import Identity, Observation, Place, untimely
from milepost.estimation.time_units import S_PER_NS

from ..hypotheses import Doubts
from ..readings import Judge
from ..rule import NO_DOUBTS, NO_JUDGES, Fused, LocalBelief
from .combination import fuse

# deleting from the front of a list costs its length, so it is done for many entries at once
FORGET_AT_LEAST = 64


class FederatedFusion:
    """The sources' rule: each filter's last belief is predicted to the epoch with Q/β and weighted by its information.

    A fix corrects the fused state, s_g = s_b up to its variance, and reaches the filters with the feedback. There is no
    rewind: a late estimate replaces nothing, a late fix is taken at the next epoch with h = [1, -T, T²/2], T its age.
    With feedback, the filter that was heard first is the origin, and another one counts after its first feedback: before,
    it starts from the train file's prior at another time, or after a restart at another position.
    Source: A (12)-(17), B.
    """

    needs_shares: ClassVar[bool] = True

    def __init__(
        self,
        layout: Layout,  # noqa: ARG002
        jerk_psd: float,
        prior: Prior,  # noqa: ARG002
        horizon_ns: int,
        feedback: bool,
        judges: Mapping[str, Judge] = NO_JUDGES,  # noqa: ARG002
        doubts: Doubts = NO_DOUBTS,  # noqa: ARG002
    ) -> None:
        self.names = list(COMMON)
        self.counters = Counters()
        self._common = Layout()
        self._jerk_psd = jerk_psd
        self._horizon_ns = horizon_ns
        self._feedback = feedback
        self._beliefs: dict[str, list[LocalBelief]] = {}
        self._first_heard: dict[str, int] = {}
        self._fixes: list[Observation] = []
        # the epoch that takes each fix, live and settled; no other epoch does
        self._taken_at: dict[Place, int] = {}
        self._seen: dict[Identity, int] = {}

    def take_estimate(
        self, unit: str, belief: LocalBelief, observations: Sequence[Observation], now_ns: int
    ) -> list[str | None]:
        """Keep the belief; the observations are not needed."""
        reason = self._untimely(belief.at_ns, now_ns)
        if reason is None and min(row[i] for i, row in enumerate(belief.covariance[:3])) <= 0.0:
            reason = "no_variance"
        if reason is not None:
            return [reason] * max(1, len(observations))
        self._first_heard.setdefault(unit, belief.at_ns)
        insort(self._beliefs.setdefault(unit, []), belief, key=lambda b: b.at_ns)
        return [None] * len(observations)

    def _untimely(self, at_ns: int, now_ns: int) -> str | None:
        return untimely(at_ns, now_ns - self._horizon_ns, now_ns)

    def take_fix(self, fix: Observation, now_ns: int) -> str | None:
        """Keep the fix for the next epoch."""
        identity = fix.identity
        reason = "duplicate" if identity in self._seen else self._untimely(fix.measured_at_ns, now_ns)
        if reason is not None:
            return reason
        self._seen[identity] = fix.measured_at_ns
        self._fixes.append(fix)
        return None

    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        """Nothing to do: the filters' beliefs contain it."""

    def kept(self) -> Kept | None:
        """Nothing: the filters' next beliefs contain it."""
        return None

    def resume(self, kept: Kept) -> None:
        """Nothing to do."""

    def state_at(self, at_ns: int, shares: Mapping[str, float], live: bool = False) -> Fused | None:  # noqa: ARG002
        """Equations (12)-(13) over the reporting units, then the update by the waiting fixes."""
        last = {unit: b for unit, share in shares.items() if share > 0.0 and (b := self._last(unit, at_ns)) is not None}
        if self._feedback:
            fed = {unit: b for unit, b in last.items() if b.fed}
            last = fed or dict(sorted(last.items(), key=lambda item: self._first_heard[item[0]])[:1])
        if not last:
            return None
        mean, covariance = fuse([self._carried(b, at_ns, shares[unit]) for unit, b in last.items()])
        for fix in sorted(
            f for f in self._fixes if f.measured_at_ns <= at_ns and self._taken_at.setdefault(f.place, at_ns) == at_ns
        ):
            age = (at_ns - fix.measured_at_ns) * S_PER_NS
            row = row_now(fix.row, age)
            mean, covariance = update(mean, covariance, row, fix.value, fix.variance)
        return Fused(mean.tolist(), covariance.tolist(), {}, min(self._first_heard.values()))

    def _last(self, unit: str, at_ns: int) -> LocalBelief | None:
        kept = self._beliefs.get(unit, [])
        place = bisect_right(kept, at_ns, key=lambda b: b.at_ns)
        return kept[place - 1] if place else None

    def _carried(self, belief: LocalBelief, at_ns: int, share: float) -> tuple[Array, Array]:
        mean, covariance = np.array(belief.mean)[:3], np.array(belief.covariance)[:3, :3]
        if at_ns == belief.at_ns:
            return mean, covariance
        kernel = kernel_for(self._common, self._jerk_psd / share)
        state = kernel.advance(kernel.pack(mean, covariance), (at_ns - belief.at_ns) * S_PER_NS)  # type: ignore[arg-type]
        return kernel.unpack(state)  # type: ignore[arg-type]

    def advance_to(self, now_ns: int) -> None:
        """Drop beliefs and fixes that no epoch needs any more; each unit's last belief before the horizon stays."""
        boundary = now_ns - self._horizon_ns
        for kept in self._beliefs.values():
            place = bisect_right(kept, boundary, key=lambda b: b.at_ns) - 1
            if place >= FORGET_AT_LEAST:
                del kept[:place]
        if len(self._seen) >= FORGET_AT_LEAST:
            self._seen = {key: at for key, at in self._seen.items() if at >= boundary}
            self._fixes = [f for f in self._fixes if f.measured_at_ns >= boundary - self._horizon_ns]
            self._taken_at = {f.place: self._taken_at[f.place] for f in self._fixes if f.place in self._taken_at}


def row_now(row: tuple[float, ...], age_s: float) -> Array:
    """A row h over [s, v, a] of `age_s` ago as a row over the present state: h F(-T), process noise over T neglected."""
    return np.asarray(np.array(row[:3]) @ transition(-age_s))
