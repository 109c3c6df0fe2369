"""Recursive least squares with a forgetting factor: a local parabola through a sensor's last readings."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..kalman import update
from ..layout import Array
from ..motion import transition

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


def linear_gain_terms(mean: Array, covariance: Array, observe: Callable[[Array], Array]) -> tuple[float, Array, float]:
    """y = xᵀw, P x and xᵀ P x, for the x that `observe` picks."""
    x = observe(np.eye(len(mean)))
    g = covariance @ x
    return float(x @ mean), g, float(x @ g)


GainTerms = Callable[[Array, Array, Callable[[Array], Array]], tuple[float, Array, float]]


class Predicted(NamedTuple):
    """The parabola's prediction of the next reading: y, P x, xᵀ P x and the variance of y, these in units of R."""

    value: float
    cross: Array
    spread: float
    variance: float


class LocalParabola:
    """w = [value, rate, curvature] of a reading now, by exponentially forgetting least squares.

    Cost J = Σ λ^(n-i) w_i e_i² [C (7)]. Between readings w ← F(T) w, P ← F P Fᵀ, which keeps the time's origin at the
    newest reading; then P ← P/λ, k = P x/(1/ω + xᵀ P x), w ← w + k e, P ← (I - k xᵀ) P, with x = [1, 0, 0], e = z - xᵀw and
    ω the reading's weight. That is C (1)-(5) with k = P x/(λ/ω + xᵀ P x); (2) is lost, (5) prints w for xᵀ.
    P is the inverse of the weighted normal matrix. The variance of w for readings of variance R/ω is R V, kept beside
    it: V ← (I - k xᵀ) F V Fᵀ (I - k xᵀ)ᵀ + k kᵀ/ω; P and V differ, because forgetting is no noise.

    A parabola follows constant acceleration without lag, and needs no belief: its output does not contain the errors of
    the state that it will correct. Rejected: smoothing the innovation, which returns the state's own error as a measurement.
    """

    def __init__(self, terms: GainTerms = linear_gain_terms) -> None:
        self._terms = terms
        self.restart()

    def restart(self) -> None:
        """Begin again without any reading."""
        self.w, self.P, self.V = np.zeros(3), PRIOR_VARIANCE * np.eye(3), PRIOR_VARIANCE * np.eye(3)
        self._useful = False

    def advance(self, dt_s: float) -> bool:
        """Move the origin of time by `dt_s`; returns True after a gap so long that the parabola restarts."""
        F = transition(dt_s)
        self.w, self.P, self.V = F @ self.w, F @ self.P @ F.T, F @ self.V @ F.T
        lost = self._useful and self.V[0, 0] > RESET_VARIANCE
        if lost:
            self.restart()
        return bool(lost)

    def predicted(self) -> Predicted:
        """The prediction of a reading now."""
        variance = float(self.V[0, 0])
        self._useful = self._useful or variance < MAX_USEFUL_VARIANCE
        return Predicted(*self._terms(self.w, self.P, level), variance)

    def learn(self, predicted: Predicted, value: float, forgetting: float, weight: float = 1.0) -> float:
        """Take a reading z with factor λ and weight ω; returns the smoothed reading xᵀw."""
        k = predicted.cross / (forgetting / weight + predicted.spread)
        self.w = self.w + k * (value - predicted.value)
        # symmetric by construction, unlike (P - k xᵀP)/λ, which loses definiteness under rounding
        self.P = update(self.w, self.P / forgetting, X, 0.0, 1.0 / weight)[1]
        A = np.eye(3) - np.outer(k, X)
        self.V = A @ self.V @ A.T + np.outer(k, k) / weight
        return float(self.w[0])


def white_sum(response: Array) -> tuple[float, float]:
    """The output variance Σg² of a filter with impulse response g for unit white noise, and 1 + 2Σρ_k of its error.

    Their product is (Σg)², so a smoother that passes a constant unchanged has R_eff = R Σg² (1 + 2Σρ_k) = R: smoothing
    makes each reading's variance smaller and adds no information.
    """
    correlation = np.correlate(response, response, mode="full")
    return float(correlation[len(response) - 1]), float(correlation.sum() / correlation[len(response) - 1])


class ForgettingSmoother:
    """Adaptive RLS with a fixed forgetting factor: smoothed readings z' with the effective variance R_eff.

    `forgetting` λ; `start` the variance that the sensor states, `memory` readings over which the noise is estimated:
    R̂ = mean of e²/(1 + V_yy). R_eff = Var(z') (1 + 2Σρ_k) = R̂ (see `white_sum`), stated as R̂ (n + 2)/n for n
    effective readings, because R̂ is uncertain. After a long gap it restarts.
    Source: C (1)-(7), the noise estimate is ours.
    """

    def __init__(self, forgetting: float, start: float, memory: int) -> None:
        self._forgetting = forgetting
        self._memory = float(memory)
        self._weight = 0.0
        self._parabola = LocalParabola()
        self.noise_variance = start

    @property
    def variance(self) -> float:
        """R_eff of a reading now."""
        if self._weight < SETTLING:
            return self.noise_variance * (1.0 + SETTLING - self._weight)
        n = self._weight if self._weight < self._memory else 2.0 * self._memory
        return self.noise_variance * (n + 2.0) / n

    def step(self, dt_s: float, value: float) -> tuple[float, float]:
        """A reading z, `dt_s` after the last: z' and R_eff."""
        self._parabola.advance(dt_s)
        predicted = self._parabola.predicted()
        smoothed = self._parabola.learn(predicted, value, self._forgetting)
        if predicted.variance < MAX_USEFUL_VARIANCE:
            self._weight = min(self._weight + 1.0, self._memory)
            sample = (value - predicted.value) ** 2 / (1.0 + predicted.variance)
            self.noise_variance += (sample - self.noise_variance) / max(self._weight, 2.0)
        return smoothed, self.variance
