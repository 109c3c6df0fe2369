"""The error equation of an inertial unit, learned while the fused state is trustworthy and used when it no longer is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from milepost.estimation.layout import Array

# a step longer than this many readings is a gap: what was not measured cannot be integrated; two or three lost ones can be
GAP = 4.5
LONGEST_MEMORY_S = 3600.0


@dataclass(frozen=True)
class InertialErrorModel:
    """What the data sheet says, and how to learn.

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


@dataclass
class _Window:
    """A sample in the making: since when, at what speed, and the integrals of z and of z - â since then."""

    begin_s: float
    speed: float
    speed_variance: float
    last_s: float
    last: tuple[float, float]
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def add(self, t_s: float, values: tuple[float, float]) -> None:
        half = 0.5 * (t_s - self.last_s)
        self.sums = [total + half * (a + b) for total, a, b in zip(self.sums, self.last, values, strict=True)]
        self.last_s, self.last = t_s, values


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
        self.information = np.eye(3)
        self._eta = np.zeros(3)
        self._begun_s: float | None = None
        self._learned_s = 0.0
        self._psi = 0.0
        self._psi_s = 0.0
        self._window: _Window | None = None
        self._fitted = (0.0, self._variance())

    @property
    def weights(self) -> Array:
        """A, B, C."""
        return np.asarray(np.linalg.solve(self.information, self._eta))

    def regressors(self) -> Array:
        """φ = (δ, σ √(t_j - t_m), ψ(m; j)), where learning stands."""
        since = 0.0 if self._begun_s is None else self._learned_s - self._begun_s
        return np.array([self.model.bias_std, self.model.walk_std * math.sqrt(since), self._psi])

    def learn(self, t_s: float, dt_s: float, z: float, speed: float, speed_variance: float, acceleration: float) -> bool:
        """Take a reading z (mean over `dt_s`, true at `t_s`) beside the fused speed and acceleration; True with a new fit.

        One that comes late teaches nothing, and costs nothing either.
        """
        window, values = self._window, (z, z - acceleration)
        if window is not None and t_s <= window.last_s:
            return False
        if window is None or t_s - window.last_s >= GAP * dt_s:
            self._window = _Window(t_s, speed, speed_variance, t_s, values)
            return False
        window.add(t_s, values)
        T = t_s - window.begin_s
        if self.model.window_s - 0.5 * dt_s > T:
            return False
        self._begun_s = window.begin_s if self._begun_s is None else self._begun_s
        self._learned_s = t_s
        self._psi_s = min(self._psi_s + T, self.model.memory_s)
        self._psi += T / self._psi_s * (window.sums[1] / T - self._psi)
        y = (window.sums[0] - (speed - window.speed)) / T
        self.fit(y, (self.model.noise_density**2 * T + window.speed_variance + speed_variance) / (T * T), T)
        self._window = _Window(t_s, speed, speed_variance, t_s, values)
        return True

    def fit(self, y: float, variance: float, step_s: float) -> None:
        """One step of the least squares, with a sample of ε that is true where the regressors stand."""
        forget = math.exp(-step_s / self.model.memory_s)
        phi = self.regressors()
        self.information = forget * self.information + (1.0 - forget) * np.eye(3) + np.outer(phi, phi) / variance
        self._eta = forget * self._eta + phi * (y / variance)
        self._fitted = (float(phi @ self.weights), self._variance())

    def _variance(self) -> float:
        phi = self.regressors()
        return float(phi @ np.linalg.solve(self.information, phi))

    def pause(self) -> None:
        """The fused state is not to be trusted: the sample in the making is dropped, what was learned stays."""
        self._window = None

    def correction(self, t_s: float) -> tuple[float, float]:
        """ε̂ = φᵀ w as learned last, and its variance at a time: φᵀ Λ⁻¹ φ + σ² (t - t_learned), at most δ² more."""
        age = max(0.0, t_s - self._learned_s)
        wander = min(self.model.walk_std**2 * age, self.model.bias_std**2)
        return self._fitted[0], self._fitted[1] + wander


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
