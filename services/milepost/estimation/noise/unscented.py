"""The unscented transform of a mean and covariance by a nonlinear function."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..layout import Array


def sigma_points(mean: Array, covariance: Array, kappa: float) -> Array:
    """The 2n + 1 points x̂, x̂ ± columns of √((n + κ) P), shape (..., 2n + 1, n).

    mean (..., n), covariance (..., n, n) positive definite, κ > -n. Raises numpy.linalg.LinAlgError where one is not
    definite. Julier and Uhlmann 1997; C (9) is lost, this is a reconstruction.
    """
    # the root of the correlation matrix, because the states' units differ by orders of magnitude
    scale = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    root = scale[..., :, None] * np.linalg.cholesky(covariance / (scale[..., :, None] * scale[..., None, :]))
    offsets = np.sqrt(mean.shape[-1] + kappa) * np.swapaxes(root, -1, -2)
    middle = mean[..., None, :]
    return np.concatenate([middle, middle + offsets, middle - offsets], axis=-2)


def unscented_gain_terms(
    mean: Array, covariance: Array, observe: Callable[[Array], Array], kappa: float = 0.0
) -> tuple[Array, Array, Array]:
    """Predicted observation y, cross-covariance P_xy (n) and variance P_yy of y = g(x), in place of P x and xᵀ P x.

    `observe` g maps points (..., n) to values (...). Weights W₀ = κ/(n + κ), W_i = 1/(2(n + κ)). For linear g = h x it gives
    h x̂, P h and h P hᵀ exactly. Source: C (9)-(12), lost; a reconstruction.
    """
    points = sigma_points(mean, covariance, kappa)
    values = observe(points)
    n = mean.shape[-1]
    weights = np.full(2 * n + 1, 0.5 / (n + kappa))
    weights[0] = kappa / (n + kappa)
    y = (values * weights).sum(axis=-1)
    away = values - y[..., None]
    cross = ((weights * away)[..., None, :] @ (points - mean[..., None, :]))[..., 0, :]
    return y, cross, (weights * away * away).sum(axis=-1)
