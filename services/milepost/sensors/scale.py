"""A speed that is off by an unknown scale, as an observation of the speed and of the scale."""

from __future__ import annotations

from milepost.estimation.layout import N_COMMON, PrivateState

from .base import Belief, Observed

SCALE = N_COMMON


def scaled_speed(speed_mps: float, variance_m2ps2: float, belief: Belief | None, scale: PrivateState) -> Observed:
    """z = v/(1 + κ) + e, e ~ N(0, R): what a wheel or a radar says whose calibration is off by κ, the only private state.

    With μ = 1 + κ̂, the expected reading ẑ = v̂/μ and the innovation ν = z - ẑ: v - ẑ κ = ẑ + μ ν + δκ w - μ e, where δκ is
    the error of κ̂ and w that of ẑ. So h = [0, 1, 0, -ẑ], value ẑ + μ ν + E[δκ w], variance μ² R + Var(δκ w), with
    E[δκ w] = c/μ, Var(δκ w) = (P_κκ h P hᵀ + c²)/μ², c = P_κv - ẑ P_κκ. Without a belief ẑ = z, μ = 1 + prior.
    For a wheel κ is true over told diameter, less one.

    Why κ divides: for a mean reading z all (v, κ) that explain it lie on the straight line v = (1 + κ) z, which one row
    holds exactly: what is left out, δκ w, fades as ẑ becomes known, whatever κ's uncertainty. In z = (1 + κ) v they lie on a
    hyperbola; δκ δv is then one error common to all readings until κ is known. At 60 m/s and κ ~ N(0, 0.03²), 100 readings
    a second: NEES 4.3 here, 111 there (75 with the mean and variance of δκ δv in each reading), for 4.
    """
    if belief is None:
        row = (0.0, 1.0, 0.0, -speed_mps)
        return Observed(row, speed_mps, ((1.0 + scale.prior_mean) ** 2 + scale.prior_std**2) * variance_m2ps2)
    v, k, P = float(belief.mean[1]), float(belief.mean[SCALE]), belief.covariance
    P_vv, P_kv, P_kk = float(P[1, 1]), float(P[1, SCALE]), float(P[SCALE, SCALE])
    mu = 1.0 + k
    expected = v / mu
    hPh = P_vv - 2.0 * expected * P_kv + expected * expected * P_kk
    c = P_kv - expected * P_kk
    value = expected + mu * (speed_mps - expected) + c / mu
    variance = mu * mu * variance_m2ps2 + (P_kk * hPh + c * c) / (mu * mu)
    return Observed((0.0, 1.0, 0.0, -expected), value, variance)
