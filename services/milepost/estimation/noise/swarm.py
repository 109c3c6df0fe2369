"""A particle swarm with a bounded number of evaluations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..layout import Array

ACCELERATION = 2.6
TOP_SPEED = 10.0
# Clerc and Kennedy 2002 for φ = 2 · 2.6: without it the particles reach the speed limit and stay there
CONSTRICTION = 2.0 / (5.2 - 2.0 + (5.2**2 - 4.0 * 5.2) ** 0.5)


class Swarm:
    """Particles in a box, each attracted by its own best place and by the best of all.

    v ← χ (v + c₁ r₁ (p - x) + c₂ r₂ (g - x)), |v| ≤ v_max; x ← x + v, kept in the box. c₁ = c₂ = 2.6, r uniform in [0, 1],
    v_max = 10, as the source says; coordinates are such that the box is v_max wide, because the source gives no unit for
    its speed. Ours: χ (see CONSTRICTION), and generations per call given by the caller, where the source lets them grow
    with n without bound. Deterministic: the seed is an argument. Source: C 1.2.2.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float], particles: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._low = np.array(low, dtype=float)
        self._width = (np.array(high, dtype=float) - self._low) / TOP_SPEED
        self._places = self._rng.uniform(0.0, TOP_SPEED, size=(particles, len(self._low)))
        self._places[0] = 0.5 * TOP_SPEED
        self._speeds = np.zeros_like(self._places)
        self._own = self._places.copy()
        self.evaluations = 0

    def minimise(self, cost: Callable[[Array], float], generations: int) -> Array:
        """The best place found for `cost` (a function of the coordinates): particles · (generations + 1) evaluations.

        The particles' own bests are kept between calls as places and evaluated anew, because the cost has changed.
        """
        bests = np.array([self._evaluate(cost, place) for place in self._own])
        for _ in range(generations):
            leader = self._own[int(np.argmin(bests))]
            r1, r2 = self._rng.uniform(size=(2, *self._places.shape))
            pull = ACCELERATION * (r1 * (self._own - self._places) + r2 * (leader - self._places))
            self._speeds = np.clip(CONSTRICTION * (self._speeds + pull), -TOP_SPEED, TOP_SPEED)
            self._places = np.clip(self._places + self._speeds, 0.0, TOP_SPEED)
            costs = np.array([self._evaluate(cost, place) for place in self._places])
            better = costs < bests
            self._own[better], bests[better] = self._places[better], costs[better]
        return np.asarray(self._low + self._width * self._own[int(np.argmin(bests))])

    def _evaluate(self, cost: Callable[[Array], float], place: Array) -> float:
        self.evaluations += 1
        return cost(self._low + self._width * place)
