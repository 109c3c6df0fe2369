"""The sources' fusion rule: beliefs are weighted by their information, which the shares β distribute."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from milepost.estimation.layout import Array


def fuse(beliefs: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Fuse beliefs at one epoch: P_g = [Σ P_i⁻¹]⁻¹, x_g = P_g Σ P_i⁻¹ x_i.

    Each belief: mean (n), covariance (n, n). Raises ValueError where there is none. Source: A (12)-(13).
    """
    if not beliefs:
        raise ValueError("at least one belief is required")
    if len(beliefs) == 1:
        return beliefs[0]
    first, reference = beliefs[0][0], beliefs[0][1]
    # every covariance is scaled by one common diagonal: metres beside m/s² lose digits in the inversion otherwise
    scale: Array = np.sqrt(np.diag(reference))
    area: Array = np.outer(scale, scale)
    inverses: list[Array] = [np.asarray(np.linalg.inv(P / area), dtype=float) for _, P in beliefs]
    weighted = [inverse @ ((mean - first) / scale) for inverse, (mean, _) in zip(inverses, beliefs, strict=True)]
    fused: Array = np.asarray(np.linalg.inv(np.sum(inverses, axis=0)), dtype=float)
    return first + scale * (fused @ np.sum(weighted, axis=0)), 0.5 * (fused + fused.T) * area


def share_out(shares: Mapping[str, float], reporting: Sequence[str]) -> dict[str, float]:
    """The shares β of the reporting units, Σβ = 1: a silent unit's share goes to the others in proportion.

    Units whose shares are all zero share evenly. Source: A (14), B.
    """
    total = sum(shares.get(unit, 0.0) for unit in reporting)
    if total <= 0.0:
        return {unit: 1.0 / len(reporting) for unit in reporting}
    return {unit: shares.get(unit, 0.0) / total for unit in reporting}
