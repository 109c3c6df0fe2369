"""The H∞ filter's steps for one scalar observation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .kalman import ArrayKernel, update
from .layout import Array, Layout


@dataclass(slots=True)
class Existence:
    """How often the existence condition held and failed since the counts were read last."""

    held: int = 0
    failed: int = 0


def bounded_update(x: Array, P: Array, h: Array, z: float, R: float, L: Array, gamma: float) -> tuple[Array, Array] | None:
    """Take one scalar observation so that the worst-case error in L x stays within γ; None where no such filter exists.

    K = P h/(h P hᵀ + R); x ← x + K (z - h x); P⁻¹ ← P⁻¹ + hᵀR⁻¹h - γ⁻²LᵀL, which must stay positive definite.
    x (n), P (n, n), h (n), z and R scalar; L (m, n) with each row divided by the error that counts as one, so that L x has
    no unit; γ > 0. The source's weights are normalised: its H is h/√R. Computed as the Kalman update and then for each row l
    P ← P + γ⁻² P lᵀ l P/(1 - γ⁻² l P lᵀ): the inverse is definite exactly if every denominator is positive.
    Source: D (9), (12), (14); (10), (11), (13) lost their formulas and are the prediction with the P that (14) gives.
    """
    x, P = update(x, P, h, z, R)
    for row in L:
        g = P @ row
        left = gamma * gamma - float(row @ g)
        if left <= 0.0:
            return None
        P = P + np.outer(g, g) / left
    return x, P


class HInfinityKernel(ArrayKernel):
    """The two steps over a layout, for a timeline; where the filter does not exist the step is the Kalman filter's.

    `combinations` L (m, n), normalised; None takes the observed combination, L = h/√R, as the source does with its one
    state: then P⁻¹ ← P⁻¹ + (1 - γ⁻²) hᵀR⁻¹h, and the filter exists for every γ > 1.
    """

    def __init__(
        self,
        layout: Layout,
        jerk_psd: float,
        gamma: float = math.inf,
        combinations: Array | None = None,
        existence: Existence | None = None,
    ) -> None:
        super().__init__(layout, jerk_psd)
        self.gamma = gamma
        self.combinations = combinations
        self.existence = existence or Existence()

    def update(self, state: tuple[Array, Array], row: tuple[float, ...], value: float, variance: float) -> tuple[Array, Array]:
        """The belief after one observation."""
        h = np.array(row)
        L = h[None, :] / math.sqrt(variance) if self.combinations is None else self.combinations
        bounded = bounded_update(*state, h, value, variance, L, self.gamma)
        if bounded is None:
            self.existence.failed += 1
            return super().update(state, row, value, variance)
        self.existence.held += 1
        return self.stretched(state, row, bounded)
