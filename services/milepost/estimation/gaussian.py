"""Beliefs as means and covariances: a common block replaced or divided while the private states follow."""

from __future__ import annotations

import numpy as np

from .layout import N_COMMON, Array


def check_share(share: float) -> None:
    """Raises ValueError for a share β outside (0, 1]."""
    if not 0.0 < share <= 1.0:
        raise ValueError(f"share must lie in (0, 1], not {share}")


def replace_common(mean: Array, covariance: Array, common_mean: Array, common_covariance: Array) -> tuple[Array, Array]:
    """Replace the belief in the common states; the private states follow by conditioning.

    p(common, private) ← p'(common) p(private | common). With G = P_pc P_cc⁻¹ and C = P_pp - G P_cp:
    x_p ← x_p + G (x'_c - x_c), P_pc ← G P'_cc, P_pp ← C + G P'_cc Gᵀ.
    mean (n), covariance (n, n), common_mean (3), common_covariance (3, 3). Jeffrey's rule for Gaussians.
    """
    if len(mean) == N_COMMON:
        return np.array(common_mean), np.array(common_covariance)
    pc = covariance[N_COMMON:, :N_COMMON]
    G = pc @ inverse_3x3(covariance)
    cross = G @ common_covariance
    private = covariance[N_COMMON:, N_COMMON:] - G @ pc.T + cross @ G.T
    new_mean, new_covariance = np.empty_like(mean), np.empty_like(covariance)
    new_mean[:N_COMMON] = common_mean
    new_mean[N_COMMON:] = mean[N_COMMON:] + G @ (common_mean - mean[:N_COMMON])
    new_covariance[:N_COMMON, :N_COMMON] = common_covariance
    new_covariance[N_COMMON:, :N_COMMON], new_covariance[:N_COMMON, N_COMMON:] = cross, cross.T
    new_covariance[N_COMMON:, N_COMMON:] = 0.5 * (private + private.T)
    return new_mean, new_covariance


def inflate_common(mean: Array, covariance: Array, share: float) -> Array:
    """Divide the common block by the share β, P_cc ← P_cc/β, the private states following by conditioning.

    With G = P_pc P_cc⁻¹: P_pc ← G P_cc/β = P_pc/β, P_pp ← P_pp + (1/β - 1) G P_cp. Without private states it is the sources'
    P_i = P_g/β_i. mean (n), covariance (n, n), share in (0, 1]. Raises ValueError for any other share. Source: A (15)-(16).
    """
    check_share(share)
    if share == 1.0:
        return np.array(covariance)
    inflated = np.array(covariance) / share
    if len(mean) > N_COMMON:
        cp = covariance[:N_COMMON, N_COMMON:]
        gained = cp.T @ (inverse_3x3(covariance) @ cp)
        inflated[N_COMMON:, N_COMMON:] = covariance[N_COMMON:, N_COMMON:] + (0.5 / share - 0.5) * (gained + gained.T)
    return inflated


def stretched(before: Array, mean: Array, covariance: Array, scale: int) -> Array:
    """The covariance after a reading z = v/(1 + κ) has moved the mean: P ← T P Tᵀ, T = I + (x_c - x⁻_c) e_κᵀ/(1 + κ̂⁻).

    Such readings cannot tell (v, a, κ) from c (v, a, 1 + κ), so δκ moves v by v/(1 + κ) δκ. T keeps that true for the new v.
    Without it the next row, taken at another v, seems to measure κ: at 50 m²/s⁵ two wheels alone gain 3.7 σ of κ in a minute.
    It is the update in the coordinates (v/(1 + κ), a/(1 + κ), κ), in which the reading is linear, carried back.
    before, mean (n), covariance (n, n) after the update, scale the place of κ. Source: Barrau, Bonnabel, invariant filter.
    """
    T = np.eye(len(mean))
    T[:N_COMMON, scale] += (mean - before)[:N_COMMON] / (1.0 + before[scale])
    P = T @ covariance @ T.T
    return 0.5 * (P + P.T)


def inverse_3x3(covariance: Array) -> Array:
    """The inverse of the common block of a covariance (n, n), by cofactors: a call of LAPACK costs ten times as much.

    Raises numpy.linalg.LinAlgError where the block is not positive definite.
    """
    (a, b, c), (_, d, e), (_, _, f) = covariance[:N_COMMON, :N_COMMON].tolist()
    return np.array(common_inverse(a, b, c, d, e, f))


def common_inverse(a: float, b: float, c: float, d: float, e: float, f: float) -> list[list[float]]:
    """The inverse of [[a, b, c], [b, d, e], [c, e, f]], by cofactors.

    Raises numpy.linalg.LinAlgError where the matrix is not positive definite.
    """
    df, bf, be = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * df + b * bf + c * be
    if not (a > 0.0 and d > 0.0 and f > 0.0 and determinant > 0.0):
        raise np.linalg.LinAlgError("the common block is not positive definite")
    ac, ae, ad = a * f - c * c, b * c - a * e, a * d - b * b
    cofactors = ((df, bf, be), (bf, ac, ae), (be, ae, ad))
    return [[cofactor / determinant for cofactor in row] for row in cofactors]
