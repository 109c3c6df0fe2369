"""A particle swarm with a bounded number of evaluations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..layout import Array

ACCELERATION = 2.6
TOP_SPEED = 10.0
# Clerc and Kennedy 2002 for φ = 2 · 2.6: without it the particles reach the speed limit and stay there
CONSTRICTION = 2.0 / (5.2 - 2.0 + (5.2**2 - 4.0 * 5.2) ** 0.5)


class Particles(NamedTuple):
    """The places, the speeds and the own best places (m, particles, d) of m swarms."""

    places: Array
    speeds: Array
    own: Array


class Swarm:
    """Particles in a box, each attracted by its own best place and by the best of all.

    v ← χ (v + c₁ r₁ (p - x) + c₂ r₂ (g - x)), |v| ≤ v_max; x ← x + v, kept in the box. c₁ = c₂ = 2.6, r uniform in [0, 1],
    v_max = 10, as the source says; coordinates are such that the box is v_max wide, because the source gives no unit for
    its speed. Ours: χ (see CONSTRICTION), and generations per call given by the caller, where the source lets them grow
    with n without bound. Deterministic: the seed and the number of the search are arguments. Source: C 1.2.2.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float], particles: int, seed: int) -> None:
        self._seed, self._particles = seed, particles
        self._low = np.array(low, dtype=float)
        self._width = (np.array(high, dtype=float) - self._low) / TOP_SPEED

    def begin(self, m: int) -> Particles:
        """Places drawn at random, the first in the middle; all m swarms alike."""
        places = TOP_SPEED * _draws(self._seed, 0, (self._particles, len(self._low)))
        places[0] = 0.5 * TOP_SPEED
        places = np.tile(places, (m, 1, 1))
        return Particles(places, np.zeros_like(places), places)

    def search(
        self, memory: Particles, cost: Callable[[Array], Array], turn: Array, generations: Array
    ) -> tuple[Array, Particles]:
        """The best places (m, d) found for `cost`, (m, particles, d) to (m, particles), and the particles after it.

        `turn` (m): the number of the search; `generations` (m): it takes particles · (generations + 1) evaluations.
        The particles' own bests are kept between searches as places and evaluated anew, because the cost has changed.
        """
        places, speeds, own = memory
        bests = self._evaluated(cost, own)
        most = int(generations.max())
        shape = (most, 2, self._particles, len(self._low))
        random = np.stack([_draws(self._seed, k, shape) for k in turn.tolist()], axis=2)
        for generation, (r1, r2) in enumerate(random):
            active = (generation < generations)[:, None, None]
            pull = ACCELERATION * (r1 * (own - places) + r2 * (_leader(own, bests) - places))
            speeds = np.where(active, np.clip(CONSTRICTION * (speeds + pull), -TOP_SPEED, TOP_SPEED), speeds)
            places = np.where(active, np.clip(places + speeds, 0.0, TOP_SPEED), places)
            costs = self._evaluated(cost, places)
            better = costs < bests
            own, bests = np.where(better[..., None], places, own), np.where(better, costs, bests)
        return self._low + self._width * _leader(own, bests)[:, 0], Particles(places, speeds, own)

    def _evaluated(self, cost: Callable[[Array], Array], places: Array) -> Array:
        return cost(self._low + self._width * places)


def _leader(own: Array, bests: Array) -> Array:
    """The best place (m, 1, d) of each swarm."""
    return np.take_along_axis(own, bests.argmin(axis=1)[:, None, None], axis=1)


@lru_cache(maxsize=256)
def _drawn(seed: int, turn: int, shape: tuple[int, ...]) -> Array:
    return np.random.default_rng((seed, turn)).uniform(size=shape)


def _draws(seed: int, turn: int, shape: tuple[int, ...]) -> Array:
    """Uniform random numbers in [0, 1) of a search: the same whenever it is made again."""
    return _drawn(seed, turn, shape).copy()
