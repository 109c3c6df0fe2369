"""The Kalman filter's two steps for the common states and one private state, unrolled: a wheel, a radar, an inertial unit.

A belief is a pair: that of the common states, (s, v, a, P00, P01, P02, P11, P12, P22) as in `scalar`, and (p, c0, c1, c2, r):
the private state p, its covariances with s, v and a, and its variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .gaussian import common_inverse
from .layout import Array, PrivateState
from .motion import private_step
from .observation import Observation
from .scalar import ScalarKernel, Scalars

Private = tuple[float, float, float, float, float]
Belief = tuple[Scalars, Private]


@dataclass(frozen=True)
class PrivateScalarKernel:
    """Predict and update over [s, v, a, p]; equations as in `kalman` and `motion`. `jerk_psd` q in m²/s⁵."""

    state: PrivateState
    jerk_psd: float
    common: ScalarKernel = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "common", ScalarKernel(self.jerk_psd))

    def pack(self, mean: Array, covariance: Array) -> Belief:
        """A belief in the kernel's form."""
        return self.shared(np.asarray(mean, dtype=float).tolist(), np.asarray(covariance, dtype=float).tolist(), 1.0)

    def prior(self, mean: Array, covariance: Array) -> Belief:
        """The prior in the kernel's form."""
        return self.pack(mean, covariance)

    def shared(self, mean: Sequence[float] | Array, covariance: Sequence[Sequence[float]] | Array, share: float) -> Belief:
        """A belief with its common block divided by the share β, the private state following as in `inflate_common`.

        From lists, as in messages, or arrays. Raises numpy.linalg.LinAlgError where the common block is not positive definite.
        """
        (p00, p01, p02, c0), (_, p11, p12, c1), (_, _, p22, c2), (_, _, _, r) = covariance
        s, v, a, p = mean
        if share < 1.0:
            # G = P_pc P_cc⁻¹, P_pp ← P_pp + (1/β - 1) G P_cp
            G0, G1, G2 = [i0 * c0 + i1 * c1 + i2 * c2 for i0, i1, i2 in common_inverse(p00, p01, p02, p11, p12, p22)]
            r += (1.0 / share - 1.0) * (G0 * c0 + G1 * c1 + G2 * c2)
        common = (s, v, a, p00 / share, p01 / share, p02 / share, p11 / share, p12 / share, p22 / share)
        return common, (p, c0 / share, c1 / share, c2 / share, r)

    def unpack(self, state: Belief) -> tuple[Array, Array]:
        """The mean (4) and covariance (4, 4) of a belief."""
        mean, covariance = self.lists(state)
        return np.array(mean), np.array(covariance)

    def lists(self, state: Belief) -> tuple[list[float], list[list[float]]]:
        """The mean (4) and covariance (4, 4) of a belief as lists, for messages."""
        (s, v, a, p00, p01, p02, p11, p12, p22), (p, c0, c1, c2, r) = state
        return [s, v, a, p], [[p00, p01, p02, c0], [p01, p11, p12, c1], [p02, p12, p22, c2], [c0, c1, c2, r]]

    def advance(self, state: Belief, dt_s: float) -> Belief:
        """The belief `dt_s` seconds later: x ← F x, P ← F P Fᵀ + Q."""
        p, c0, c1, c2, r = state[1]
        decay, noise = private_step(self.state, dt_s)
        c0, c1 = c0 + dt_s * c1 + 0.5 * dt_s * dt_s * c2, c1 + dt_s * c2
        return self.common.advance(state[0], dt_s), (decay * p, decay * c0, decay * c1, decay * c2, decay * decay * r + noise)

    def update(self, state: Belief, row: tuple[float, ...], value: float, variance: float) -> Belief:
        """The belief after one scalar observation, in Joseph's form; `gaussian.stretched` where p scales the motion."""
        (s, v, a, p00, p01, p02, p11, p12, p22), (p, c0, c1, c2, r) = state
        h0, h1, h2, h3 = row
        g0 = p00 * h0 + p01 * h1 + p02 * h2 + c0 * h3
        g1 = p01 * h0 + p11 * h1 + p12 * h2 + c1 * h3
        g2 = p02 * h0 + p12 * h1 + p22 * h2 + c2 * h3
        g3 = c0 * h0 + c1 * h1 + c2 * h2 + r * h3
        w = 1.0 / (h0 * g0 + h1 * g1 + h2 * g2 + h3 * g3 + variance)
        k0, k1, k2, k3 = g0 * w, g1 * w, g2 * w, g3 * w
        e = value - (h0 * s + h1 * v + h2 * a + h3 * p)
        # A = (I - K h) P, then P = A (I - K h)ᵀ + K R Kᵀ = A + (K R - A h) Kᵀ
        a00, a01, a02, a03 = p00 - k0 * g0, p01 - k0 * g1, p02 - k0 * g2, c0 - k0 * g3
        a10, a11, a12, a13 = p01 - k1 * g0, p11 - k1 * g1, p12 - k1 * g2, c1 - k1 * g3
        a20, a21, a22, a23 = p02 - k2 * g0, p12 - k2 * g1, p22 - k2 * g2, c2 - k2 * g3
        a30, a31, a32, a33 = c0 - k3 * g0, c1 - k3 * g1, c2 - k3 * g2, r - k3 * g3
        b0 = k0 * variance - (a00 * h0 + a01 * h1 + a02 * h2 + a03 * h3)
        b1 = k1 * variance - (a10 * h0 + a11 * h1 + a12 * h2 + a13 * h3)
        b2 = k2 * variance - (a20 * h0 + a21 * h1 + a22 * h2 + a23 * h3)
        b3 = k3 * variance - (a30 * h0 + a31 * h1 + a32 * h2 + a33 * h3)
        p00, p01, p02, p11, p12, p22 = (
            a00 + b0 * k0,
            a01 + b0 * k1,
            a02 + b0 * k2,
            a11 + b1 * k1,
            a12 + b1 * k2,
            a22 + b2 * k2,
        )
        c0, c1, c2, r = a03 + b0 * k3, a13 + b1 * k3, a23 + b2 * k3, a33 + b3 * k3
        if self.state.scales_motion and h3 != 0.0:
            # as in `gaussian.stretched`
            step = e / (1.0 + p)
            d0, d1, d2 = k0 * step, k1 * step, k2 * step
            # with u = c + d r/2: P + d uᵀ + u dᵀ
            u0, u1, u2 = c0 + 0.5 * r * d0, c1 + 0.5 * r * d1, c2 + 0.5 * r * d2
            p00, p01, p02 = p00 + 2.0 * d0 * u0, p01 + d0 * u1 + d1 * u0, p02 + d0 * u2 + d2 * u0
            p11, p12, p22 = p11 + 2.0 * d1 * u1, p12 + d1 * u2 + d2 * u1, p22 + 2.0 * d2 * u2
            c0, c1, c2 = c0 + r * d0, c1 + r * d1, c2 + r * d2
        return (s + k0 * e, v + k1 * e, a + k2 * e, p00, p01, p02, p11, p12, p22), (p + k3 * e, c0, c1, c2, r)

    def take(self, state: Belief, observation: Observation) -> Belief:
        """The belief after one observation of a timeline."""
        return self.update(state, observation.row, observation.value, observation.variance)
