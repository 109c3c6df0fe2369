"""The Kalman filter's two steps for H beliefs at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from milepost.estimation.layout import N_COMMON, Array

from .evidence import Flags

# of so many shapes of P the arrays in between are kept
KEPT_SHAPES = 8
# S/R beyond which rounding in P - K gᵀ would tell: 2e-16 S of the R that are left
WELL_WITHIN = 1e4


class Stack:
    """`kalman.predict` and `kalman.update` over x (H, n), P (H, n, n). Not for two threads at once.

    Two arrays of the size of P are kept for what is computed in between. A belief of 33 hypotheses has 20 kB: new memory for
    each step would push everything else out of the processor's cache.
    """

    def __init__(self) -> None:
        self._kept: dict[tuple[int, ...], tuple[Array, Array]] = {}

    def predict(self, x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
        """x ← F x, P ← F P Fᵀ + Q; F (n, n), Q (n, n)."""
        first, second = self._between(P)
        np.matmul(F, P, out=first)
        # the rows of all beliefs in one product
        n = len(F)
        np.matmul(first.reshape(-1, n), F.T, out=second.reshape(-1, n))
        return x @ F.T, second + Q

    def innovations(self, x: Array, P: Array, h: Array, z: Any, R: Any) -> tuple[Array, Array, Array]:
        """g = P h (H, n), S = h g + R (H) and ν = z - h x (H), for h (n) of all beliefs, or h (H, n) of each."""
        if h.ndim == 1:
            # the rows of all beliefs in one product, here too
            g = (P.reshape(-1, len(h)) @ h).reshape(x.shape)
            return g, g @ h + R, z - x @ h
        g = (P @ h[:, :, None])[:, :, 0]
        return g, (g * h).sum(axis=1) + R, z - (x * h).sum(axis=1)

    def update(
        self, x: Array, P: Array, h: Array, R: Any, innovations: tuple[Array, Array, Array], taken: Flags, scale: int | None
    ) -> tuple[Array, Array]:
        """The update in Joseph's form (see `kalman.update`), with gain 0 for the beliefs that do not take it.

        h (n) or (H, n), R scalar or (H), `innovations` as above, `taken` (H), `scale` the place of a state of the unit that
        scales the motion: then P follows as in `gaussian.stretched`.
        """
        g, S, nu = innovations
        A, more = self._between(P)
        K = (taken / S)[:, None] * g
        np.multiply(K[:, :, None], g[:, None, :], out=A)
        np.subtract(P, A, out=A)
        if np.count_nonzero(taken & (S > WELL_WITHIN * R)):
            Ah = A @ h if h.ndim == 1 else (A @ h[:, :, None])[:, :, 0]
            B = (R if isinstance(R, float) else R[:, None]) * K - Ah
            np.multiply(B[:, :, None], K[:, None, :], out=more)
            A += more
        step = K * nu[:, None]
        if scale is not None:
            d = step[:, :N_COMMON] / (1.0 + x[:, scale, None])
            # A ← (1 + d eᵀ) A (1 + e dᵀ), e the scale's unit vector; what is added to the columns is added to the rows instead:
            # the symmetric part is the same, at half the cost
            w = A[:, scale] + A[:, :, scale]
            w[:, :N_COMMON] += A[:, scale, scale, None] * d
            A[:, :N_COMMON] += d[:, :, None] * w[:, None, :]
        out = A + A.transpose(0, 2, 1)
        out *= 0.5
        return x + step, out

    def _between(self, P: Array) -> tuple[Array, Array]:
        kept = self._kept.get(P.shape)
        if kept is None:
            if len(self._kept) >= KEPT_SHAPES:
                self._kept.clear()
            kept = self._kept[P.shape] = np.empty_like(P), np.empty_like(P)
        return kept
