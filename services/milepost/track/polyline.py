"""A polyline on a plane: nearest points, the parts that pass a point, kinks, and parts that are near each other."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# the step between the compared points, as a share of the distance: parts up to this much farther apart count as near too
COARSENESS = 0.25
# a kink this near a chainage is at it: the nearest points that stay on a kink are rounded
AT_A_KINK_M = 0.01
# a cell of the grid and half of those around it, which gives each pair of neighbours once
NEIGHBOURS = ((0, 0), (1, 0), (0, 1), (1, 1), (1, -1))


class Foot(NamedTuple):
    """The nearest point of the line to a point: its chainage, and how far to the right of the line the point lies."""

    position_m: float
    right_m: float


class Polyline:
    """A polyline with its own chainage, extended straight beyond its ends.

    `x_m`, `y_m` (n): vertices on a plane. `chainage_m` (n): increasing; it need not be the length on the plane.
    """

    def __init__(self, x_m: Array, y_m: Array, chainage_m: Array) -> None:
        dx, dy = np.diff(x_m), np.diff(y_m)
        self._length = np.hypot(dx, dy)
        self._vertices = (x_m, y_m, chainage_m)
        self._x, self._y = x_m[:-1].copy(), y_m[:-1].copy()
        self._ux, self._uy = dx / self._length, dy / self._length
        ratio = np.diff(chainage_m) / self._length
        columns = (x_m[:-1], y_m[:-1], self._ux, self._uy, self._length, chainage_m[:-1], ratio)
        # plain floats are faster for a single segment
        self._segments: list[tuple[float, ...]] = np.column_stack(columns).tolist()
        kinks = np.diff(np.unwrap(np.arctan2(dy, dx)))
        self._kink_at: list[float] = chainage_m[1:-1].tolist()
        self._turned: list[float] = np.concatenate([[0.0], np.cumsum(2.0 * np.tan(0.5 * np.abs(kinks)))]).tolist()

    def nearest(self, x_m: float, y_m: float) -> Foot:
        """The nearest point of the line; beyond an end, that of the end's extension."""
        along, squares = self._feet(x_m, y_m)
        k = int(squares.argmin())
        return self._foot(k, float(along[k]), x_m, y_m)

    def passing(self, x_m: float, y_m: float, within_m: float, apart_m: float) -> list[Foot]:
        """The nearest points of all parts of the line that pass within a distance, nearest first.

        A part has a local minimum of the distance; of minima closer than `apart_m` along the line the nearest counts.
        """
        along, squares = self._feet(x_m, y_m)
        low = squares <= within_m * within_m
        low[1:] &= squares[1:] <= squares[:-1]
        low[:-1] &= squares[:-1] <= squares[1:]
        places = np.flatnonzero(low)
        found: list[Foot] = []
        for k in places[np.argsort(squares[places], kind="stable")].tolist():
            foot = self._foot(k, float(along[k]), x_m, y_m)
            if all(abs(foot.position_m - other.position_m) > apart_m for other in found):
                found.append(foot)
        return found

    def comes_near_itself(self, within_m: float, apart_m: float) -> bool:
        """Whether points farther than `apart_m` from each other along the line are closer than `within_m`.

        Points every within/4 are compared, cell by cell of a grid, so that the answer may be yes up to 1.25 `within_m`.
        """
        x, y, chainage = self._vertices
        step = COARSENESS * within_m
        along = np.linspace(chainage[0], chainage[-1], math.ceil((chainage[-1] - chainage[0]) / step) + 1)
        place = np.column_stack([np.interp(along, chainage, x), np.interp(along, chainage, y)])
        cell = np.floor((place - place.min(axis=0)) / (within_m + step)).astype(np.int64) + 1
        stride = int(cell[:, 1].max()) + 2
        key = cell[:, 0] * stride + cell[:, 1]
        order = np.argsort(key, kind="stable")
        for right, up in NEIGHBOURS:
            wanted = key + right * stride + up
            first = np.searchsorted(key[order], wanted, "left")
            count = np.searchsorted(key[order], wanted, "right") - first
            one = np.repeat(np.arange(len(key)), count)
            other = order[np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)]
            apart = np.abs(along[one] - along[other]) > apart_m
            one, other = one[apart], other[apart]
            if np.any(np.hypot(*(place[one] - place[other]).T) <= within_m + step):
                return True
        return False

    def turning(self, from_m: float, to_m: float) -> float:
        """Σ 2 tan(θ/2) over the kinks θ between two chainages, in either order; for small kinks their sum in radians."""
        low, high = min(from_m, to_m) - AT_A_KINK_M, max(from_m, to_m) + AT_A_KINK_M
        return self._turned[bisect_right(self._kink_at, high)] - self._turned[bisect_left(self._kink_at, low)]

    def _feet(self, x_m: float, y_m: float) -> tuple[Array, Array]:
        """How far along each segment its nearest point lies, m (n - 1), and the squares of the distances, m² (n - 1)."""
        ex, ey = x_m - self._x, y_m - self._y
        along = ex * self._ux
        along += ey * self._uy
        np.maximum(along, 0.0, out=along)
        np.minimum(along, self._length, out=along)
        ex -= along * self._ux
        ey -= along * self._uy
        ex *= ex
        ey *= ey
        ex += ey
        return along, ex

    def _foot(self, k: int, along_m: float, x_m: float, y_m: float) -> Foot:
        x, y, ux, uy, length, chainage, ratio = self._segments[k]
        ex, ey = x_m - x, y_m - y
        if (k == 0 and along_m <= 0.0) or (k == len(self._segments) - 1 and along_m >= length):
            along_m = ex * ux + ey * uy
        ex, ey = ex - along_m * ux, ey - along_m * uy
        return Foot(chainage + along_m * ratio, math.copysign(math.hypot(ex, ey), uy * ex - ux * ey))
