"""The present noise of a sensor whose noise varies and has outliers: a Bayesian grid over log σ."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np

from ..layout import Array
from .learner import Judged, Seen

# the number of stored transition matrices, by step: a sensor has one period and some jitter, rounded to a millisecond
KEPT_STEPS = 64
LEAST_LIKELIHOOD = 1e-300
# z' stays within 1.5 times the innovation; more costs consistency of the innovations, less of the result
LEAST_GAIN = 2.0 / 3.0
# the least predicted variance, as a share of the stated R: a smaller one makes no difference
LEAST_EXPECTED = 1e-9


class NoiseModel(NamedTuple):
    """Noise e ~ (1 - ε) N(0, σ²) + ε N(0, κ²σ²), ln σ an Ornstein-Uhlenbeck process.

    `lowest`, `highest`: the range of σ over the stated one; `levels`: of the grid; `time_constant_s` τ and
    `spread` s (standard deviation of ln σ) of the process; `outlier_share` ε; `outlier_ratio` κ.
    """

    lowest: float
    highest: float
    levels: int = 24
    time_constant_s: float = 20.0
    spread: float = 0.6
    outlier_share: float = 0.05
    outlier_ratio: float = 10.0


class Levels(NamedTuple):
    """The weights of the levels (m, levels), and the variance that was stated first (m)."""

    weights: Array
    stated: Array


class NoiseScale:
    """The posterior p_j of the levels ln σ_j, one innovation at a time, and the Gaussian site of each observation.

    Between observations p ← p M(T), M the Ornstein-Uhlenbeck transition over T on the grid. An innovation e = z - h x̂ of
    predicted variance c = h P hᵀ has the likelihoods l_ji = w_i N(e; 0, c + r_ji), i regular or outlier, r_ji = σ_j² or
    κ²σ_j². With the posterior weights π_ji and the gains K_ji = c/(c + r_ji) the exact posterior of h x has mean
    x̂ + K̄ e and variance c(1 - K̄) + Var(K) e². The site is the Gaussian observation that gives the same two moments:
    K' = max(K̄ - Var(K) e²/c, 2 K̄/3), z' = h x̂ + (K̄/K') e, R' = c (1 - K')/K'.

    Rejected: R = 1/E[1/r | z] with z unchanged. It states the information of a filter that knows which readings are outliers,
    and is overconfident (NEES 3.5 for 3). The bound 2 K̄/3 is met where it is undecided whether a reading is an outlier:
    without it z' is unbounded there. Adaptive Gaussian-sum filtering (Sorenson and Alspach 1971) collapsed to moments, the
    site as in expectation propagation (Minka 2001); no source has it.
    """

    needs_belief: ClassVar[bool] = True

    def __init__(self, model: NoiseModel) -> None:
        self.model = model
        self._levels = np.linspace(math.log(model.lowest), math.log(model.highest), model.levels)
        regular = np.exp(2.0 * self._levels)
        self._variances = np.concatenate([regular, regular * model.outlier_ratio**2])
        self._shares = np.repeat([1.0 - model.outlier_share, model.outlier_share], model.levels)
        self._steps: dict[int, Array] = {}

    def begin(self, variance: Array) -> Levels:
        """Nothing but the range of σ is known."""
        return Levels(np.full((len(variance), self.model.levels), 1.0 / self.model.levels), variance)

    def take(self, memory: Levels, dt_s: float, seen: Seen) -> tuple[Judged, Levels]:
        """The site of a reading, and the weights after it."""
        memory = self.advance(memory, dt_s)
        judged, weights = self._site(memory, seen)
        return judged, memory._replace(weights=weights)

    def judge(self, memory: Levels, seen: Seen) -> Judged:
        """The site of a reading."""
        return self._site(memory, seen)[0]

    def std(self, memory: Levels) -> Array:
        """The posterior mean of σ (m)."""
        return np.asarray(np.sqrt(memory.stated) * (memory.weights @ np.exp(self._levels)))

    def advance(self, memory: Levels, dt_s: float) -> Levels:
        """The weights `dt_s` seconds later, p ← p M(T)."""
        step = round(dt_s * 1e3)
        if step <= 0:
            return memory
        matrix = self._steps.get(step)
        if matrix is None:
            if len(self._steps) >= KEPT_STEPS:
                self._steps.clear()
            matrix = self._steps[step] = self._transition(step * 1e-3)
        return memory._replace(weights=memory.weights @ matrix)

    def _site(self, memory: Levels, seen: Seen) -> tuple[Judged, Array]:
        """The site of an observation as z' and R', and the weights after it."""
        e = seen.innovation
        c, e2 = np.maximum(seen.predicted, LEAST_EXPECTED * seen.variance), e * e
        total = memory.stated[:, None] * self._variances + c[:, None]
        exponent = -0.5 * (e2[:, None] / total + np.log(total))
        joint = self._shares * np.tile(memory.weights, 2) * np.exp(exponent - exponent.max(axis=1, keepdims=True))
        joint += LEAST_LIKELIHOOD
        joint /= joint.sum(axis=1, keepdims=True)
        gains = c[:, None] / total
        mean_gain = (joint * gains).sum(axis=1)
        spread = np.maximum((joint * gains * gains).sum(axis=1) - mean_gain * mean_gain, 0.0)
        gain = np.maximum(mean_gain - spread * e2 / c, LEAST_GAIN * mean_gain)
        levels = self.model.levels
        site = Judged(seen.value - e + mean_gain / gain * e, c * (1.0 - gain) / gain)
        return site, joint[:, :levels] + joint[:, levels:]

    def _transition(self, dt_s: float) -> Array:
        # reversion to the middle of the grid; on a grid coarser than the step, three points with the right two moments
        levels, width = self._levels, self._levels[1] - self._levels[0]
        keep = math.exp(-dt_s / self.model.time_constant_s)
        shift = (keep - 1.0) * (levels - levels.mean()) / width
        variance = (self.model.spread / width) ** 2 * -math.expm1(-2.0 * dt_s / self.model.time_constant_s)
        if variance > 1.0:
            away = (levels[None, :] - levels[:, None]) / width - shift[:, None]
            matrix = np.exp(-0.5 * away * away / variance)
        else:
            up = np.maximum(0.5 * (variance + shift * shift + shift), 0.0)
            down = np.maximum(0.5 * (variance + shift * shift - shift), 0.0)
            matrix = np.diag(up[:-1], 1) + np.diag(down[1:], -1)
            matrix += np.diag(np.maximum(1.0 - matrix.sum(axis=1), 0.0))
        return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))
