"""The Kalman filter's two steps for one scalar observation, over any number of states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .gaussian import inflate_common, stretched
from .layout import Array, Layout
from .motion import Steps
from .observation import Observation


def predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """Predict a belief forward: x ← F x, P ← F P Fᵀ + Q.

    x (n), P (n, n), F (n, n), Q (n, n). Source: A (3), (6).
    """
    return F @ x, F @ P @ F.T + Q


def update(x: Array, P: Array, h: Array, z: float, R: float) -> tuple[Array, Array]:
    """Update a belief with one scalar observation z = h x + e, e ~ N(0, R).

    K = P h / (h P hᵀ + R); x ← x + K (z - h x); P ← (I - K h) P (I - K h)ᵀ + K R Kᵀ (Joseph's form, which stays
    symmetric and positive semi-definite under rounding), written as two rank-1 steps. Rejected: P - (M + Mᵀ) with
    M = K (g - s K/2)ᵀ, the same in four calls less: with P 1e8 times R, as before a first reading, it loses definiteness.
    x (n), P (n, n), h (n), z and R scalar, R > 0. Source: A (4), (5), (7).
    """
    g = P @ h
    K = g / (float(h @ g) + R)
    column = K[:, None]
    A = P - column * g
    P_new = A + (R * column - A @ h[:, None]) * K
    P_new += P_new.T
    P_new *= 0.5
    return x + K * (z - float(h @ x)), P_new


class ArrayKernel:
    """The two steps over a layout with private states, on states that are opaque to the timeline.

    A kernel is made with every feedback that brings another share, so making one costs next to nothing.
    """

    def __init__(self, layout: Layout, jerk_psd: float) -> None:
        self.layout = layout
        self.jerk_psd = jerk_psd
        self._steps = Steps(layout, jerk_psd)
        self._scales = tuple(layout.scales.values())

    def pack(self, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """A belief in the kernel's form."""
        return np.array(mean, dtype=float), np.array(covariance, dtype=float)

    def prior(self, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """The prior in the kernel's form."""
        return self.pack(mean, covariance)

    def shared(
        self, mean: Sequence[float] | Array, covariance: Sequence[Sequence[float]] | Array, share: float
    ) -> tuple[Array, Array]:
        """A belief with its common block divided by the share β, the private states following."""
        x, P = np.array(mean, dtype=float), np.array(covariance, dtype=float)
        return x, inflate_common(x, P, share)

    def unpack(self, state: tuple[Array, Array]) -> tuple[Array, Array]:
        """The mean (n) and covariance (n, n) of a belief."""
        return state

    def lists(self, state: tuple[Array, Array]) -> tuple[list[float], list[list[float]]]:
        """The mean (n) and covariance (n, n) of a belief as lists, for messages."""
        return state[0].tolist(), state[1].tolist()

    def advance(self, state: tuple[Array, Array], dt_s: float) -> tuple[Array, Array]:
        """The belief `dt_s` seconds later."""
        return predict(*state, *self._steps.over(dt_s))

    def update(self, state: tuple[Array, Array], row: tuple[float, ...], value: float, variance: float) -> tuple[Array, Array]:
        """The belief after one observation."""
        return self.stretched(state, row, update(*state, np.array(row), value, variance))

    def stretched(self, before: tuple[Array, Array], row: tuple[float, ...], after: tuple[Array, Array]) -> tuple[Array, Array]:
        """The belief after an observation, where that is of a unit that scales the motion, as in `gaussian.stretched`."""
        for place in self._scales:
            if row[place] != 0.0:
                return after[0], stretched(before[0], *after, place)
        return after

    def take(self, state: tuple[Array, Array], observation: Observation) -> tuple[Array, Array]:
        """The belief after one observation of a timeline."""
        return self.update(state, observation.row, observation.value, observation.variance)
