"""Recursive least squares with a forgetting factor: a local parabola through a sensor's last readings."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import numpy as np

from ..layout import Array
from ..motion import transition
from .learner import Flags, Judged, Seen, kept_where

# the variance of the parabola's coefficients before the first reading, in units of the noise: nothing is known
PRIOR_VARIANCE = 1e8
# above this variance, in units of R, nothing is learned from a prediction: too few readings, or a long gap
MAX_USEFUL_VARIANCE = 30.0
RESET_VARIANCE = 1e3
# below this weight of innovations, only the sensor's stated noise is known
SETTLING = 8.0
X = np.eye(3)[0]
X.setflags(write=False)


def level(points: Array) -> Array:
    """The observed combination xᵀw, x = [1, 0, 0]: the parabola now."""
    return points[..., 0]


def linear_gain_terms(mean: Array, covariance: Array, observe: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
    """y = xᵀw, P x and xᵀ P x, for the x that `observe` picks, for one mean and covariance or for many."""
    x = observe(np.eye(mean.shape[-1]))
    g = covariance @ x
    return (mean * x).sum(axis=-1), g, (g * x).sum(axis=-1)


GainTerms = Callable[[Array, Array, Callable[[Array], Array]], tuple[Array, Array, Array]]


class Predicted(NamedTuple):
    """The prediction of the next reading: y, P x, xᵀ P x and the variance of y, these in units of R; for m parabolas."""

    value: Array
    cross: Array
    spread: Array
    variance: Array


class Parabola(NamedTuple):
    """w = [value, rate, curvature] of a reading now, by exponentially forgetting least squares; m of them.

    Cost J = Σ λ^(n-i) w_i e_i² [C (7)]. Between readings w ← F(T) w, P ← F P Fᵀ, which keeps the time's origin at the
    newest reading; then P ← P/λ, k = P x/(1/ω + xᵀ P x), w ← w + k e, P ← (I - k xᵀ) P, with x = [1, 0, 0], e = z - xᵀw and
    ω the reading's weight. That is C (1)-(5) with k = P x/(λ/ω + xᵀ P x); (2) is lost, (5) prints w for xᵀ.
    P is the inverse of the weighted normal matrix. The variance of w for readings of variance R/ω is R V, kept beside
    it: V ← (I - k xᵀ) F V Fᵀ (I - k xᵀ)ᵀ + k kᵀ/ω; P and V differ, because forgetting is no noise.
    w (m, 3), P and V (m, 3, 3), `useful` (m): a reading was predicted well enough to learn from it.

    A parabola follows constant acceleration without lag, and needs no belief: its output does not contain the errors of
    the state that it will correct. Rejected: smoothing the innovation, which returns the state's own error as a measurement.
    """

    w: Array
    P: Array
    V: Array
    useful: Flags

    @classmethod
    def begin(cls, m: int) -> Parabola:
        """Without any reading."""
        nothing = np.tile(PRIOR_VARIANCE * np.eye(3), (m, 1, 1))
        return cls(np.zeros((m, 3)), nothing, nothing, np.zeros(m, dtype=bool))

    def advanced(self, dt_s: float) -> tuple[Parabola, Flags]:
        """With the origin of time moved by `dt_s`, and which (m) restart after a gap that is too long."""
        F = transition(dt_s)
        out = Parabola((F @ self.w[:, :, None])[:, :, 0], F @ self.P @ F.T, F @ self.V @ F.T, self.useful)
        lost = self.useful & (out.V[:, 0, 0] > RESET_VARIANCE)
        return (kept_where(~lost, out, self.begin(len(lost))) if lost.any() else out), lost

    def predicted(self, terms: GainTerms = linear_gain_terms) -> Predicted:
        """The prediction of a reading now."""
        return Predicted(*terms(self.w, self.P, level), self.V[:, 0, 0])

    def taught(self, predicted: Predicted, value: Array, forgetting: Array | float, weight: Array) -> Parabola:
        """After a reading z (m) with factor λ and weight ω (m)."""
        k = predicted.cross / (forgetting / weight + predicted.spread)[:, None]
        w = self.w + k * (value - predicted.value)[:, None]
        # Joseph's form, unlike (P - k xᵀP)/λ, which loses definiteness under rounding
        P = self.P / np.reshape(forgetting, (-1, 1, 1))
        g, R = P[:, :, 0], (1.0 / weight)[:, None]
        K = g / (g[:, :1] + R)
        A = P - K[:, :, None] * g[:, None, :]
        P = A + (R * K - A[:, :, 0])[:, :, None] * K[:, None, :]
        A = np.eye(3) - k[:, :, None] * X
        V = A @ self.V @ A.transpose(0, 2, 1) + k[:, :, None] * k[:, None, :] / weight[:, None, None]
        return Parabola(w, 0.5 * (P + P.transpose(0, 2, 1)), V, self.useful | (predicted.variance < MAX_USEFUL_VARIANCE))


def white_sum(response: Array) -> tuple[float, float]:
    """The output variance Σg² of a filter with impulse response g for unit white noise, and 1 + 2Σρ_k of its error.

    Their product is (Σg)², so a smoother that passes a constant unchanged has R_eff = R Σg² (1 + 2Σρ_k) = R: smoothing
    makes each reading's variance smaller and adds no information.
    """
    correlation = np.correlate(response, response, mode="full")
    return float(correlation[len(response) - 1]), float(correlation.sum() / correlation[len(response) - 1])


class Forgetting(NamedTuple):
    """The memory of m smoothers: R̂ (m) is a mean of `weight` (m) readings."""

    parabola: Parabola
    noise: Array
    weight: Array


class ForgettingSmoother:
    """Adaptive RLS with a fixed forgetting factor: smoothed readings z' with the effective variance R_eff.

    `forgetting` λ; `memory` readings over which the noise is estimated: R̂ = mean of e²/(1 + V_yy), at first the stated R.
    R_eff = Var(z') (1 + 2Σρ_k) = R̂ (see `white_sum`), stated as R̂ (n + 2)/n for n effective readings, because R̂ is
    uncertain. After a long gap it restarts. A late reading passes unchanged, with the variance of a reading now.
    Source: C (1)-(7), the noise estimate is ours.
    """

    needs_belief: ClassVar[bool] = False

    def __init__(self, forgetting: float, memory: int) -> None:
        self._forgetting, self._memory = forgetting, float(memory)

    def begin(self, variance: Array) -> Forgetting:
        """R̂ is the stated R."""
        return Forgetting(Parabola.begin(len(variance)), variance, np.zeros(len(variance)))

    def take(self, memory: Forgetting, dt_s: float, seen: Seen) -> tuple[Judged, Forgetting]:
        """The smoothed reading and R_eff."""
        parabola = memory.parabola.advanced(dt_s)[0]
        predicted = parabola.predicted()
        e, S = seen.value - predicted.value, 1.0 + predicted.variance
        useful = predicted.variance < MAX_USEFUL_VARIANCE
        weight = np.where(useful, np.minimum(memory.weight + 1.0, self._memory), memory.weight)
        step = (e * e / S - memory.noise) / np.maximum(weight, 2.0)
        noise = np.where(useful, memory.noise + step, memory.noise)
        parabola = parabola.taught(predicted, seen.value, self._forgetting, np.ones_like(S))
        memory = Forgetting(parabola, noise, weight)
        return Judged(parabola.w[:, 0], self._variance(memory)), memory

    def judge(self, memory: Forgetting, seen: Seen) -> Judged:
        """The reading unchanged, with R_eff."""
        return Judged(seen.value, self._variance(memory))

    def _variance(self, memory: Forgetting) -> Array:
        return memory.noise * inflation(memory.weight, self._memory)


def inflation(weight: Array, memory: float) -> Array:
    """By how much R̂ from `weight` readings is raised, because it is uncertain."""
    n = np.where(weight < memory, weight, 2.0 * memory)
    return np.where(weight < SETTLING, 1.0 + SETTLING - weight, (n + 2.0) / np.maximum(n, 1.0))
