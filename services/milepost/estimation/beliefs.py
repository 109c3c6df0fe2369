"""Many beliefs in one array, and what a unit sees of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .layout import Array


def joined(x: Array, P: Array) -> Array:
    """Means x (H, n) and covariances P (H, n, n) as H times [[P, x], [xᵀ, 0]], in one array (n + 1, n + 1, H)."""
    H, n = x.shape
    B = np.zeros((n + 1, n + 1, H))
    B[:n, :n] = P.transpose(1, 2, 0)
    B[:n, n] = B[n, :n] = x.T
    return B


class Beliefs(NamedTuple):
    """H beliefs over a unit's states [s, v, a, own private], which are at `places` (k) of `array` (see `joined`)."""

    array: Array
    places: tuple[int, ...]

    def mean(self, state: int) -> Array:
        """The means (H) of a state."""
        out: Array = self.array[self.places[state], -1]
        return out

    def covariance(self, one: int, other: int) -> Array:
        """The covariances (H) of two states."""
        out: Array = self.array[self.places[one], self.places[other]]
        return out

    def of(self, row: int) -> tuple[Array, Array]:
        """Mean (k) and covariance (k, k) of one belief."""
        whole = self.array[:, :, row]
        return whole[:, -1].take(self.places), whole.take(self.places, axis=0).take(self.places, axis=1)
