"""The Kalman filter's two steps for H beliefs at once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .layout import N_COMMON, Array, Layout
from .motion import fill, process_noise

Flags = NDArray[np.bool_]
Places = NDArray[np.int_]

# of so many shapes of beliefs the arrays in between are kept
KEPT_SHAPES = 8
# S/R beyond which rounding in P - K gᵀ would tell: 2e-16 S of the R that are left
WELL_WITHIN = 1e4


class Linear(NamedTuple):
    """z = h x + e, e ~ N(0, R): z and R for all beliefs alike or (H) for each; `present` (H): which have the row; None: all.

    h (n + 1), the last entry 0, is that of all beliefs; with `places` (k), h (k, H) is that of each, over these states.
    """

    h: Array
    z: Any
    R: Any
    present: Flags | None = None
    places: Places | None = None


class Innovations(NamedTuple):
    """g = [P h; -ν] (n + 1, H), S = h P hᵀ + R (H), its root √S (H) and ν = z - h x (H)."""

    g: Array
    S: Array
    root: Array
    nu: Array


class Step(NamedTuple):
    """The motion over an interval: F (n + 1, n + 1), Q (n + 1, n + 1, 1), and what a harder one adds to Q (3, 3, 1)."""

    F: Array
    Q: Array
    harder: Array


class Motion:
    """Makes the step over an interval; `jerk_psd` q in m²/s⁵, and how much larger that of a harder motion is.

    None is kept: readings seldom follow each other after the same nanoseconds twice.
    """

    def __init__(self, layout: Layout, jerk_psd: float, more_jerk_psd: float = 0.0) -> None:
        self._layout, self._jerk_psd, self._more_jerk_psd = layout, jerk_psd, more_jerk_psd
        self._identity = np.eye(layout.dimension + 1)

    def over(self, dt_s: float) -> Step:
        """The step over `dt_s` seconds."""
        F, Q = self._identity.copy(), np.zeros(self._identity.shape)
        fill(F, Q, dt_s, self._jerk_psd, self._layout)
        # Q is linear in the density
        return Step(F, Q[:, :, None], process_noise(dt_s, self._more_jerk_psd)[:, :, None])


class Stack:
    """`kalman.predict` and `kalman.update` over H beliefs [[P, x], [xᵀ, 0]] in one array B (n + 1, n + 1, H), see `joined`.

    Mean and covariance take the same steps in it: with h of n + 1, B h = [P h; h x]; and with g = [P h; -ν], B - g gᵀ/S is
    P - K S Kᵀ and x + K ν. The beliefs come last: numpy's innermost loop is the longer.

    Two arrays of the size of B are kept for what is computed in between. 53 beliefs over 9 states have 42 kB: new memory for
    each step would push everything else out of the processor's cache. Not for two threads at once.
    """

    def __init__(self) -> None:
        self._kept: dict[tuple[int, ...], tuple[Array, Array]] = {}

    def predict(self, B: Array, step: Step) -> Array:
        """x ← F x, P ← F P Fᵀ + Q, symmetric to the last bit: ½(A + Aᵀ) + Q."""
        first, second = self._between(B)
        m = len(B)
        np.matmul(0.5 * step.F, B.reshape(m, -1), out=first.reshape(m, -1))
        np.matmul(step.F, first, out=second)
        out: Array = second + second.transpose(1, 0, 2)
        out += step.Q
        return out

    def innovations(self, B: Array, row: Linear) -> Innovations:
        """What a row tells each belief."""
        h, places = row.h, row.places
        g = self._products(B, h, places)
        S: Array = (h @ g if places is None else (g.take(places, axis=0) * h).sum(axis=0)) + row.R
        nu: Array = row.z - g[-1]
        np.negative(nu, out=g[-1])
        return Innovations(g, S, np.sqrt(S), nu)

    def update(self, B: Array, row: Linear, innovations: Innovations, taken: Flags, scale: int | None) -> Array:
        """The update (see `kalman.update`) of the beliefs that take the row, `taken` (H).

        Where little of a variance is left, in Joseph's form. `scale`: the place of a state of the unit that scales the motion:
        then P follows as in `gaussian.stretched`.
        """
        g, S, root, _ = innovations
        w = (taken / root) * g
        # in one new array: what is written in between would be fetched into the processor's cache too
        out: Array = (-w)[:, None] * w
        out += B
        if np.count_nonzero(S > WELL_WITHIN * row.R):
            self._rounded(out, row, (taken / S) * g)
        out[-1, -1] = 0.0
        if scale is not None:
            # K ν of the common states, over 1 + κ
            self._stretch(out, w[:N_COMMON] * (w[-1] / (-1.0 - B[scale, -1])), scale)
        return out

    @staticmethod
    def _products(B: Array, h: Array, places: Places | None) -> Array:
        """B h (n + 1, H)."""
        if places is None:
            out: Array = (h @ B.reshape(len(B), -1)).reshape(B.shape[1:])
            return out
        return np.asarray((B.take(places, axis=0) * h[:, None]).sum(axis=0))

    def _rounded(self, B: Array, row: Linear, K: Array) -> None:
        """A = P - K gᵀ to Joseph's form A + (R K - A h) Kᵀ, which is 0 but for rounding."""
        lost = row.R * K - self._products(B, row.h, row.places)
        more = lost[:-1, None] * K[:-1]
        B[:-1, :-1] += 0.5 * (more + more.transpose(1, 0, 2))

    @staticmethod
    def _stretch(B: Array, d: Array, scale: int) -> None:
        """P ← (1 + d eᵀ) P (1 + e dᵀ), e the scale's unit vector, d (3, H): with u = P e, P + d uᵀ + u dᵀ + d dᵀ u_κ."""
        u = B[scale, :-1].copy()
        u[:N_COMMON] += 0.5 * u[scale] * d
        more = d[:, None] * u
        B[:N_COMMON, :-1] += more
        B[:-1, :N_COMMON] += more.transpose(1, 0, 2)

    def _between(self, B: Array) -> tuple[Array, Array]:
        kept = self._kept.get(B.shape)
        if kept is None:
            if len(self._kept) >= KEPT_SHAPES:
                self._kept.clear()
            kept = self._kept[B.shape] = np.empty(B.shape), np.empty(B.shape)
        return kept
