"""How the train moves between observations: constant acceleration, driven by continuous white jerk."""

from __future__ import annotations

import math

import numpy as np

from .layout import N_COMMON, Array, Layout, PrivateState


def transition(dt_s: float) -> Array:
    """The common states' transition F(T) = [[1, T, T²/2], [0, 1, T], [0, 0, 1]], shape (3, 3).

    Source: A (8)-(9), B, C and D alike. A's printed noise input [T²/6, T²/2, T] must be [T³/6, T²/2, T] for its units to
    agree; a misprint.
    """
    return np.array([[1.0, dt_s, 0.5 * dt_s * dt_s], [0.0, 1.0, dt_s], [0.0, 0.0, 1.0]])


def process_noise(dt_s: float, jerk_psd: float) -> Array:
    """The common states' process noise Q(T) = q [[T⁵/20, T⁴/8, T³/6], [., T³/3, T²/2], [., ., T]], shape (3, 3).

    `jerk_psd` q in m²/s⁵. White jerk in continuous time, so that Q(T₁+T₂) = F(T₂) Q(T₁) F(T₂)ᵀ + Q(T₂): asynchronous
    steps compose exactly. Rejected: A's piecewise-constant input, whose steps do not compose.
    """
    return _with_process_noise(np.zeros((N_COMMON, N_COMMON)), dt_s, jerk_psd)


def _with_process_noise(matrix: Array, dt_s: float, jerk_psd: float) -> Array:
    """Add the common states' process noise to the first block of a matrix, element by element, which is fastest."""
    t2 = dt_s * dt_s
    t3 = t2 * dt_s
    matrix[0, 0] = jerk_psd * (t2 * t3 / 20.0)
    matrix[0, 1] = matrix[1, 0] = jerk_psd * (t2 * t2 / 8.0)
    matrix[0, 2] = matrix[2, 0] = jerk_psd * (t3 / 6.0)
    matrix[1, 1] = jerk_psd * (t3 / 3.0)
    matrix[1, 2] = matrix[2, 1] = jerk_psd * (t2 / 2.0)
    matrix[2, 2] = jerk_psd * dt_s
    return matrix


def fill(F: Array, Q: Array, dt_s: float, jerk_psd: float, layout: Layout) -> None:
    """Write the motion over T into the first n rows and columns of an identity F and of Q = 0.

    F(T) and Q(T) for the common block, exp(-T/τ) and its noise for each private state.
    """
    F[0, 1] = F[1, 2] = dt_s
    F[0, 2] = 0.5 * dt_s * dt_s
    _with_process_noise(Q, dt_s, jerk_psd)
    for i, state in layout.changing:
        F[i, i], Q[i, i] = private_step(state, dt_s)


def full_step(dt_s: float, jerk_psd: float, layout: Layout) -> tuple[Array, Array]:
    """The transition and the process noise over all states, shape (n, n)."""
    F, Q = layout.identity.copy(), np.zeros((layout.dimension, layout.dimension))
    fill(F, Q, dt_s, jerk_psd, layout)
    return F, Q


def full_transition(dt_s: float, layout: Layout) -> Array:
    """The transition over all states, shape (n, n); also backwards."""
    return full_step(dt_s, 0.0, layout)[0]


def full_process_noise(dt_s: float, jerk_psd: float, layout: Layout) -> Array:
    """The process noise over all states, shape (n, n)."""
    return full_step(dt_s, jerk_psd, layout)[1]


def private_step(state: PrivateState, dt_s: float) -> tuple[float, float]:
    """A private state's transition and process noise over T: exp(-T/τ) and q τ/2 (1 - exp(-2T/τ)); for a random walk 1, q T."""
    tau = state.time_constant_s
    if tau == math.inf:
        return 1.0, state.noise_psd * dt_s
    return math.exp(-dt_s / tau), state.noise_psd * (-0.5 * tau * math.expm1(-2.0 * dt_s / tau))


# periodic sensors repeat a few intervals; aperiodic ones must not fill the memory
KEPT_INTERVALS = 256


class Steps:
    """F and Q over all states, kept by interval: to make them costs three times as much as to use them."""

    def __init__(self, layout: Layout, jerk_psd: float) -> None:
        self._layout, self._jerk_psd = layout, jerk_psd
        self._kept: dict[float, tuple[Array, Array]] = {}

    def over(self, dt_s: float) -> tuple[Array, Array]:
        """F(T) and Q(T), shape (n, n)."""
        step = self._kept.get(dt_s)
        if step is None:
            if len(self._kept) >= KEPT_INTERVALS:
                self._kept.clear()
            step = self._kept[dt_s] = full_step(dt_s, self._jerk_psd, self._layout)
        return step
