"""The rule `information`: one timeline over the full state, with a bank of hypotheses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from milepost.estimation.estimator import Estimator, Prior
from milepost.estimation.kept import Kept
from milepost.estimation.layout import Array, Layout
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S

from .bank import BankKernel
from .bank_state import Bank, protected
from .hypotheses import NOBODY, Doubts
from .readings import Judge
from .rule import NO_DOUBTS, NO_JUDGES, Fused, LocalBelief

# of what came late, so many rows are computed again for each live state, and no fewer than so many beliefs
ROWS_AT_A_TIME, LEAST_AT_A_TIME = 400, 8


class InformationFusion:
    """Milepost's rule: one timeline over the full state takes every filter's observations; it equals a centralised filter.

    A unit with a judge sends whole readings, which are linearised and judged here at their place in time.
    Rejected: the information increment as a difference of beliefs, P⁻¹ - P̄⁻¹. It is optimal without private states, but
    with them 1.13 to 1.5 times the optimum and overconfident when filters restart: a private prior is counted again.
    """

    needs_shares: ClassVar[bool] = False

    def __init__(
        self,
        layout: Layout,
        jerk_psd: float,
        prior: Prior,
        horizon_ns: int,
        feedback: bool,  # noqa: ARG002
        judges: Mapping[str, Judge] = NO_JUDGES,
        doubts: Doubts = NO_DOUBTS,
    ) -> None:
        def bank(layout: Layout, q: float) -> BankKernel:
            return BankKernel(layout, q, judges, doubts, horizon_ns / NS_PER_S)

        self.estimator = Estimator(layout, jerk_psd, prior, horizon_ns, kernels=bank)
        # a bank's step costs as much as it has rows, and no live state may wait for what came late
        rows = len(self.estimator.kernel.rows(NOBODY, frozenset(), NOBODY).sets)
        self._at_a_time = max(LEAST_AT_A_TIME, ROWS_AT_A_TIME // rows)
        self.names = layout.names
        self.counters = self.estimator.counters

    def take_estimate(
        self,
        unit: str,  # noqa: ARG002
        belief: LocalBelief,  # noqa: ARG002
        observations: Sequence[Observation],
        now_ns: int,
    ) -> list[str | None]:
        """Insert the observations; the belief is not needed."""
        return [self.estimator.insert(o, now_ns) for o in observations]

    def take_fix(self, fix: Observation, now_ns: int) -> str | None:
        """Insert the fix as one observation."""
        return self.estimator.insert(fix, now_ns)

    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        """Continue from an earlier fused state."""
        self.estimator.start_from(at_ns, mean, covariance)

    def kept(self) -> Kept | None:
        """The bank before the settled boundary, and the observations since."""
        return self.estimator.timeline.kept()

    def resume(self, kept: Kept) -> None:
        """Continue from what another fuser of this train holds. Where that cannot be computed, nothing changes."""
        self.estimator.resume(kept)

    def state_at(self, at_ns: int, shares: Mapping[str, float], live: bool = False) -> Fused | None:  # noqa: ARG002
        """The belief over all states from all observations until then; `live`: what came late may be missing."""
        bank: Bank | None = self.estimator.raw_at(at_ns, self._at_a_time if live else None)
        if bank is None or bank.since_ns is None:
            return None
        mean, covariance = self.estimator.kernel.lists(bank)
        return Fused(mean, covariance, bank.verdicts, bank.since_ns, protected(bank), bank.doubted, bank.reset, bank)

    def advance_to(self, now_ns: int) -> None:
        """Fold settled observations into the base."""
        self.estimator.advance_to(now_ns)
