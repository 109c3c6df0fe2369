"""The error equation of an inertial unit, learned while the fused state is trustworthy and used when it no longer is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from milepost.estimation.layout import Array

# a step longer than this many readings is a gap: what was not measured cannot be integrated; two or three lost ones can be
GAP = 4.5
LONGEST_MEMORY_S = 3600.0


@dataclass(frozen=True)
class InertialErrorModel:
    """The data sheet's error model, and the parameters of the learning.

    `bias_std` δ in m/s², `walk_std` σ in m/s²/√s, `noise_density` N in m/s²/√Hz; `window_s` T over which a sample is taken,
    `memory_s` of the forgetting, λ = exp(-T/memory). Left at 0, it is N/σ, beyond which a walk has wandered farther than the
    noise lets anyone see, but three windows at least.
    """

    bias_std: float
    walk_std: float
    noise_density: float
    window_s: float = 20.0
    memory_s: float = 0.0

    def __post_init__(self) -> None:
        if self.memory_s == 0.0:
            best = self.noise_density / self.walk_std if self.walk_std > 0.0 else math.inf
            object.__setattr__(self, "memory_s", min(max(3.0 * self.window_s, best), LONGEST_MEMORY_S))


class Window(NamedTuple):
    """The current sample: its start time and speed, and the integrals of z and of z - â since then."""

    begin_s: float
    speed: float
    speed_variance: float
    last_s: float
    last: tuple[float, float]
    sums: tuple[float, float] = (0.0, 0.0)

    def with_values(self, t_s: float, values: tuple[float, float]) -> Window:
        """The sample with one more reading, by the trapezium rule."""
        half = 0.5 * (t_s - self.last_s)
        sums = (
            self.sums[0] + half * (self.last[0] + values[0]),
            self.sums[1] + half * (self.last[1] + values[1]),
        )
        return self._replace(last_s=t_s, last=values, sums=sums)


class ErrorMemory(NamedTuple):
    """What was learned: the normal equations, where the regressors stand, the fitted error and its variance."""

    information: Array
    eta: Array
    fitted: tuple[float, float]
    begun_s: float | None = None
    learned_s: float = 0.0
    psi: float = 0.0
    psi_s: float = 0.0
    window: Window | None = None


class LearnedError:
    """ε(j) = A δ + B σ √(t_j - t_m) + C ψ(m; j), fitted by recursive least squares; three numbers and a 3 x 3 matrix.

    ψ(m; j): mean of z - â, what the fusion took out of the readings since learning began at t_m (over `memory_s` at most).
    A sample is the mean error over a window: y = (∫ z dt - (v̂₁ - v̂₀))/T, of variance (N² T + P_vv,0 + P_vv,1)/T². Not
    z - â itself: â was made from z, so it follows a bias that the fusion does not know; the fused speed follows it
    too, but by a constant, which the difference does not contain.

    J = Σ λ^(n-i) (y_i - φ_iᵀ w)²/R_i + wᵀ w, w = (A, B, C): the last term says that δ and σ are the data sheet's standard
    deviations; without it nothing tells A, B and C apart while ψ stands. Λ ← λ Λ + (1 - λ) I + φ φᵀ/R, η ← λ η + φ y/R,
    w = Λ⁻¹ η. Source: C (13), which fits A, B, C with a particle swarm: J is quadratic, so this is where a swarm would end.
    That σ's part grows as a random walk does is a reconstruction.
    """

    def __init__(self, model: InertialErrorModel) -> None:
        self.model = model
        self.memory = ErrorMemory(np.eye(3), np.zeros(3), (0.0, 0.0))
        self.memory = self.memory._replace(fitted=(0.0, self._variance()))

    @property
    def information(self) -> Array:
        """Λ (3, 3)."""
        return self.memory.information

    @property
    def weights(self) -> Array:
        """A, B, C."""
        return np.asarray(np.linalg.solve(self.memory.information, self.memory.eta))

    def regressors(self) -> Array:
        """φ = (δ, σ √(t_j - t_m), ψ(m; j)), where learning stands."""
        memory = self.memory
        since = 0.0 if memory.begun_s is None else memory.learned_s - memory.begun_s
        return np.array([self.model.bias_std, self.model.walk_std * math.sqrt(since), memory.psi])

    def learn(self, t_s: float, dt_s: float, z: float, speed: float, speed_variance: float, acceleration: float) -> bool:
        """Take a reading z (mean over `dt_s`, true at `t_s`) beside the fused speed and acceleration; True with a new fit.

        A late reading is ignored.
        """
        window, values = self.memory.window, (z, z - acceleration)
        if window is not None and t_s <= window.last_s:
            return False
        fresh = Window(t_s, speed, speed_variance, t_s, values)
        if window is None or t_s - window.last_s >= GAP * dt_s:
            self.memory = self.memory._replace(window=fresh)
            return False
        window = window.with_values(t_s, values)
        T = t_s - window.begin_s
        if self.model.window_s - 0.5 * dt_s > T:
            self.memory = self.memory._replace(window=window)
            return False
        psi_s = min(self.memory.psi_s + T, self.model.memory_s)
        psi = self.memory.psi + T / psi_s * (window.sums[1] / T - self.memory.psi)
        begun_s = window.begin_s if self.memory.begun_s is None else self.memory.begun_s
        self.memory = self.memory._replace(begun_s=begun_s, learned_s=t_s, psi=psi, psi_s=psi_s, window=fresh)
        y = (window.sums[0] - (speed - window.speed)) / T
        self.fit(y, (self.model.noise_density**2 * T + window.speed_variance + speed_variance) / (T * T), T)
        return True

    def fit(self, y: float, variance: float, step_s: float) -> None:
        """One step of the least squares, with a sample of ε that is true where the regressors stand."""
        forget = math.exp(-step_s / self.model.memory_s)
        phi = self.regressors()
        information = forget * self.memory.information + (1.0 - forget) * np.eye(3) + np.outer(phi, phi) / variance
        self.memory = self.memory._replace(information=information, eta=forget * self.memory.eta + phi * (y / variance))
        self.memory = self.memory._replace(fitted=(float(phi @ self.weights), self._variance()))

    def _variance(self) -> float:
        phi = self.regressors()
        return float(phi @ np.linalg.solve(self.memory.information, phi))

    def pause(self) -> None:
        """Drop the current sample because the fused state is not trusted; the learned error stays."""
        self.memory = self.memory._replace(window=None)

    def correction(self, t_s: float) -> tuple[float, float]:
        """ε̂ = φᵀ w as learned last, and its variance at a time: φᵀ Λ⁻¹ φ + σ² (t - t_learned), at most δ² more."""
        error, variance = self.memory.fitted
        age = max(0.0, t_s - self.memory.learned_s)
        return error, variance + min(self.model.walk_std**2 * age, self.model.bias_std**2)


def equivalent_white_variance(
    error_variance: float, position_variance: float, speed_variance: float, dt_s: float, longest_s: float
) -> float:
    """The white variance of readings `dt_s` apart that spoils a position as a constant error of variance c does.

    After T, c makes c T⁴/4 of position variance; white R(t) = 3 c t/Δ makes ∫ (T - t)² 3 c t dt = c T⁴/4, and 1.5 times c T² of
    speed variance. T is how long accelerations have been integrated without help: √(3 P_ss/P_vv), which is the time since
    an outage began when white noise alone drives it, and the memory of the filter before. Ours; never above `longest_s`.
    """
    T = math.sqrt(3.0 * position_variance / speed_variance)
    return 3.0 * error_variance * min(T, longest_s) / dt_s
