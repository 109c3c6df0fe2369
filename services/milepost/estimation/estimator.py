"""The one estimator that local filters and the fuser share: a timeline over a layout.

A local filter holds the common states and its own private block, the fuser holds all blocks; nothing else differs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from milepost.estimation.time_units import S_PER_NS

from .gaussian import check_share, inflate_common, replace_common
from .kalman import ArrayKernel
from .kept import Counters, Kept
from .layout import N_COMMON, Array, Layout
from .motion import full_process_noise, full_transition
from .observation import Observation
from .scalar import ScalarKernel
from .scalar_private import PrivateScalarKernel
from .timeline import Timeline


@dataclass(frozen=True)
class Prior:
    """The prior before the first observation: mean (3) and standard deviation (3) of [s, v, a]."""

    mean: Array
    std: Array


def kernel_for(layout: Layout, jerk_psd: float) -> ScalarKernel | PrivateScalarKernel | ArrayKernel:
    """The fastest kernel that holds this layout."""
    if not layout.private:
        return ScalarKernel(jerk_psd)
    return PrivateScalarKernel(layout.private[0], jerk_psd) if len(layout.private) == 1 else ArrayKernel(layout, jerk_psd)


class Estimator:
    """Beliefs over time from observations in any order, with feedback at its epoch.

    `jerk_psd` q in m²/s⁵; `share` β divides both prior and q, as the federated filter asks of a local filter
    (Q_i = Q/β_i, P_i = P/β_i); the fuser's share is 1. `kernels`: the mathematics of a step for (layout, q).
    """

    def __init__(
        self,
        layout: Layout,
        jerk_psd: float,
        prior: Prior,
        horizon_ns: int,
        share: float = 1.0,
        kernels: Callable[[Layout, float], Any] = kernel_for,
    ) -> None:
        self.layout = layout
        self._kernels = kernels
        self._jerk_psd = jerk_psd
        self._share = share
        self._prior = prior
        # the last feedback, before the share divides it
        self._last_feedback: tuple[int, Array, Array] | None = None
        mean, covariance = layout.prior(prior.mean, prior.std)
        kernel = kernels(layout, jerk_psd / share)
        self._timeline = Timeline(kernel, kernel.prior(mean, inflate_common(mean, covariance, share)), horizon_ns)

    @property
    def timeline(self) -> Timeline:
        """The timeline of observations."""
        return self._timeline

    @property
    def share(self) -> float:
        """The share β in force."""
        return self._share

    @property
    def counters(self) -> Counters:
        """The numbers of accepted, refused and replayed observations."""
        return self._timeline.counters

    def insert(self, observation: Observation, now_ns: int) -> str | None:
        """Take an observation whose row is over [s, v, a, own private] of its unit. Returns the reason if it is refused.

        A whole reading has no row yet. Raises ValueError where a row does not fit the unit's block.
        """
        if observation.reading is not None:
            return self._timeline.insert(observation, now_ns)
        row = self.layout.lift(observation.unit, observation.row)
        if row is not observation.row:
            observation = observation._replace(row=row)
        return self._timeline.insert(observation, now_ns)

    def state_at(self, at_ns: int) -> tuple[Array, Array] | None:
        """Mean (n) and covariance (n, n) at a time; None before the earliest observation."""
        state = self._timeline.state_at(at_ns)
        return None if state is None else self.kernel.unpack(state)

    def belief_at(self, at_ns: int) -> tuple[Array, Array] | None:
        """Mean (n) and covariance (n, n) at a time, also before the last feedback; None where nothing is known.

        Backwards, x(t) = F⁻¹ (x - w): P ← F⁻¹ (P + Q) F⁻ᵀ, from the fused P and q themselves, not divided by the share. The
        observations in between are not used again, so P is not too small for an observation that is true before the
        feedback and did not enter it.
        """
        base_ns, state = self._timeline.base_ns, self.state_at(at_ns)
        if state is not None or base_ns is None:
            return state
        mean, fused = self._fused_at(base_ns)
        dt_s = (base_ns - at_ns) * S_PER_NS
        F = full_transition(-dt_s, self.layout)
        return F @ mean, F @ (fused + full_process_noise(dt_s, self._jerk_psd, self.layout)) @ F.T

    def _fused_at(self, base_ns: int) -> tuple[Array, Array]:
        """The belief at the base, with the common block not divided by the share."""
        if self._last_feedback is not None and self._last_feedback[0] == base_ns:
            return self._last_feedback[1:]
        mean, shared = self.kernel.unpack(self._timeline.state_at(base_ns))
        return replace_common(mean, shared, mean[:N_COMMON], self._share * shared[:N_COMMON, :N_COMMON])

    def raw_at(self, at_ns: int, at_a_time: int | None = None) -> Any | None:
        """The belief at a time in the kernel's form; None where nothing is known.

        `at_a_time`: of what came late, so many beliefs are computed again, and the rest may be missing.
        """
        timeline = self._timeline
        return timeline.state_at(at_ns) if at_a_time is None else timeline.live_at(at_ns, at_a_time)

    def lists_at(self, at_ns: int) -> tuple[list[float], list[list[float]]] | None:
        """Mean (n) and covariance (n, n) at a time as lists: messages take no arrays."""
        state = self._timeline.state_at(at_ns)
        return None if state is None else self.kernel.lists(state)

    def advance_to(self, now_ns: int) -> None:
        """Advance the time to `now_ns`: fold settled observations into the base."""
        self._timeline.advance_to(now_ns)

    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None:
        """Continue from a belief at a time, which contains all observations until then."""
        self._timeline.rebase(at_ns, self.kernel.pack(mean, covariance))

    def resume(self, kept: Kept) -> None:
        """Continue from what another timeline holds; computed to its end first, so that a failure changes nothing."""
        resumed = Timeline.resumed(self.kernel, self._timeline.horizon_ns, kept)
        if resumed.latest_ns is not None:
            resumed.state_at(resumed.latest_ns)
        resumed.counters = self._timeline.counters
        self._timeline = resumed

    def accept_feedback(
        self, at_ns: int, mean: Sequence[float] | Array, covariance: Sequence[Sequence[float]] | Array, share: float
    ) -> bool:
        """Take the fused marginal at its epoch: rewind to it, divide the common block by β, replay.

        mean (n), covariance (n, n) over [s, v, a, own private]; or over [s, v, a] alone, from a rule that does not fuse
        private states: these are then conditioned on it from the belief at the epoch. Older feedback than the last one is
        superseded and changes nothing: returns False. Raises ValueError for a share outside (0, 1] and a singular covariance.
        Source: A (15)-(17); the conditioning of private states is ours (see `gaussian.inflate_common`).
        """
        base_ns = self._timeline.base_ns
        if base_ns is not None and at_ns <= base_ns:
            return False
        check_share(share)
        if len(mean) < self.layout.dimension:
            before = self.state_at(at_ns) or self.layout.prior(self._prior.mean, self._prior.std)
            # as lists: a kernel of plain numbers is slow with numpy's
            mean, covariance = [a.tolist() for a in replace_common(*before, np.array(mean), np.array(covariance))]
        # everything that can fail comes first, so that refused feedback changes nothing
        state = self.kernel.shared(mean, covariance, share)
        if share != self._share:
            self._share = share
            self._timeline.kernel = self._kernels(self.layout, self._jerk_psd / share)
        self._timeline.rebase(at_ns, state)
        self._last_feedback = (at_ns, np.array(mean), np.array(covariance))
        return True

    @property
    def kernel(self) -> Any:
        """The mathematics of its steps."""
        return self._timeline.kernel
