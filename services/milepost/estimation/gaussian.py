"""Beliefs as means and covariances: a common block replaced or divided while the private states follow."""

from __future__ import annotations

import numpy as np

from .layout import N_COMMON, Array


def check_share(share: float) -> None:
    """Raises ValueError for a share β outside (0, 1]."""
    if not 0.0 < share <= 1.0:
        raise ValueError(f"a share must lie in (0, 1], not {share}")


def replace_common(mean: Array, covariance: Array, common_mean: Array, common_covariance: Array) -> tuple[Array, Array]:
    """Replace the belief in the common states; the private states follow by conditioning.

    p(common, private) ← p'(common) p(private | common). With G = P_pc P_cc⁻¹ and C = P_pp - G P_cp:
    x_p ← x_p + G (x'_c - x_c), P_pc ← G P'_cc, P_pp ← C + G P'_cc Gᵀ.
    mean (n), covariance (n, n), common_mean (3), common_covariance (3, 3). Jeffrey's rule for Gaussians.
    """
    if len(mean) == N_COMMON:
        return np.array(common_mean), np.array(common_covariance)
    cc, pc = covariance[:N_COMMON, :N_COMMON], covariance[N_COMMON:, :N_COMMON]
    G = np.linalg.solve(cc, pc.T).T
    cross = G @ common_covariance
    private = covariance[N_COMMON:, N_COMMON:] - G @ pc.T + cross @ G.T
    new_mean = np.concatenate([common_mean, mean[N_COMMON:] + G @ (common_mean - mean[:N_COMMON])])
    return new_mean, np.block([[common_covariance, cross.T], [cross, 0.5 * (private + private.T)]])


def inflate_common(mean: Array, covariance: Array, share: float) -> Array:
    """Divide the common block by the share β, P_cc ← P_cc/β, the private states following by conditioning.

    Without private states it is the sources' P_i = P_g/β_i. mean (n), covariance (n, n), share in (0, 1].
    Raises ValueError for any other share. Source: A (15)-(16).
    """
    check_share(share)
    return replace_common(mean, covariance, mean[:N_COMMON], covariance[:N_COMMON, :N_COMMON] / share)[1]
