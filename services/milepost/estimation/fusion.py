"""THE TABLE OF FUSION RULES: how the fuser makes one state of what the filters and the balise service say."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from .estimator import Estimator, Prior, kernel_for
from .federated import fuse
from .kalman import update
from .layout import COMMON, Array, Layout
from .motion import transition
from .timeline import NS, Counters, Observation

# beliefs to remember for each unit: enough to find the last one before an epoch that waited out its deadline
KEPT_BELIEFS = 64
Lists = tuple[list[float], list[list[float]]]
Belief = tuple[int, list[float], list[list[float]]]


class FusionRule(Protocol):
    """What the fuser asks of a rule. Refusals come back as the reason, None where all was taken."""

    names: list[str]
    counters: Counters

    def take_estimate(
        self, unit: str, belief: Belief, observations: Sequence[Observation], now_ns: int
    ) -> list[str | None]: ...
    def take_fix(self, fix: Observation, now_ns: int) -> str | None: ...
    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None: ...
    def state_at(self, at_ns: int, shares: Mapping[str, float]) -> Lists | None: ...
    def advance_to(self, now_ns: int) -> None: ...


class InformationFusion:
    """Ours: every filter's observations into one timeline over the full state; exactly as good as a centralised filter.

    Rejected: the information increment as a difference of beliefs, P⁻¹ - P̄⁻¹. It is optimal without private states, but
    with them 1.13 to 1.5 times the optimum and overconfident when filters restart: a private prior is counted again.
    """

    def __init__(self, layout: Layout, jerk_psd: float, prior: Prior, horizon_ns: int) -> None:
        self.estimator = Estimator(layout, jerk_psd, prior, horizon_ns)
        self.names = layout.names
        self.counters = self.estimator.counters

    def take_estimate(self, unit: str, belief: Belief, observations: Sequence[Observation], now_ns: int) -> list[str | None]:  # noqa: ARG002
        """Insert the observations; the belief is not needed."""
        return [self.estimator.insert(o, now_ns) for o in observations]

    def take_fix(self, fix: Observation, now_ns: int) -> str | None:
        """One more observation."""
        return self.estimator.insert(fix, now_ns)

    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        """Continue from an earlier fused state."""
        self.estimator.start_from(at_ns, mean, covariance)

    def state_at(self, at_ns: int, shares: Mapping[str, float]) -> Lists | None:  # noqa: ARG002
        """The belief over all states from all observations until then."""
        return self.estimator.lists_at(at_ns)

    def advance_to(self, now_ns: int) -> None:
        """Fold what is settled."""
        self.estimator.advance_to(now_ns)


class FederatedFusion:
    """The sources': each filter's last belief until the epoch, carried to it with Q/β, weighted by its information.

    A fix corrects the fused state, s_g = s_b up to its variance, and reaches the filters with the feedback. Nothing can be
    rewound: a late estimate replaces nothing, a late fix is taken at the next epoch with h = [1, -T, T²/2], T its age.
    Source: A (12)-(17), B.
    """

    def __init__(self, layout: Layout, jerk_psd: float, prior: Prior, horizon_ns: int) -> None:  # noqa: ARG002
        self.names = list(COMMON)
        self.counters = Counters()
        self._common = Layout()
        self._jerk_psd = jerk_psd
        self._horizon_ns = horizon_ns
        self._beliefs: dict[str, list[Belief]] = {}
        self._fixes: list[Observation] = []
        self._seen: dict[tuple[str, int], int] = {}

    def take_estimate(self, unit: str, belief: Belief, observations: Sequence[Observation], now_ns: int) -> list[str | None]:  # noqa: ARG002
        """Keep the belief; the observations are not needed."""
        kept = self._beliefs.setdefault(unit, [])
        kept.append(belief)
        kept.sort(key=lambda b: b[0])
        del kept[:-KEPT_BELIEFS]
        return [None] * len(observations)

    def take_fix(self, fix: Observation, now_ns: int) -> str | None:
        """Keep the fix for the next epoch."""
        identity = (fix.instance, fix.sequence)
        if identity in self._seen:
            return "duplicate"
        if fix.measured_at_ns < now_ns - self._horizon_ns:
            return "too_old"
        self._seen[identity] = fix.measured_at_ns
        self._fixes.append(fix)
        return None

    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        """Nothing to do: the filters' beliefs contain it."""

    def state_at(self, at_ns: int, shares: Mapping[str, float]) -> Lists | None:
        """Equations (12)-(13) over the reporting units, then the fixes that are waiting."""
        beliefs = [b for unit, share in shares.items() if share > 0.0 and (b := self._carried(unit, at_ns, share)) is not None]
        if not beliefs:
            return None
        mean, covariance = fuse(beliefs)
        for fix in sorted(f for f in self._fixes if f.measured_at_ns <= at_ns):
            age = (at_ns - fix.measured_at_ns) * NS
            row = row_now(fix.row, age)
            mean, covariance = update(mean, covariance, row, fix.value, fix.variance)
        self._fixes = [f for f in self._fixes if f.measured_at_ns > at_ns]
        return mean.tolist(), covariance.tolist()

    def _carried(self, unit: str, at_ns: int, share: float) -> tuple[Array, Array] | None:
        kept = self._beliefs.get(unit, [])
        place = bisect_right(kept, at_ns, key=lambda b: b[0])
        if not place:
            return None
        from_ns = kept[place - 1][0]
        mean, covariance = np.array(kept[place - 1][1])[:3], np.array(kept[place - 1][2])[:3, :3]
        if at_ns == from_ns:
            return mean, covariance
        kernel = kernel_for(self._common, self._jerk_psd / share)
        return kernel.unpack(kernel.advance(kernel.pack(mean, covariance), (at_ns - from_ns) * NS))  # type: ignore[arg-type]

    def advance_to(self, now_ns: int) -> None:
        """Forget the identities of fixes that would be refused for their age anyway."""
        if len(self._seen) > KEPT_BELIEFS:
            self._seen = {key: at for key, at in self._seen.items() if at >= now_ns - self._horizon_ns}


def row_now(row: tuple[float, ...], age_s: float) -> Array:
    """A row h over [s, v, a] of `age_s` ago as a row over the present state: h F(-T), process noise over T neglected."""
    return np.asarray(np.array(row[:3]) @ transition(-age_s))


RULES: dict[str, type[InformationFusion] | type[FederatedFusion]] = {
    "information": InformationFusion,
    "federated": FederatedFusion,
}
