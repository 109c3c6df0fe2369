"""A reading as observations of the state: at one belief, or at each of many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.layout import Array


class Belief(NamedTuple):
    """The belief of a unit's filter at a reading's time: mean (n), covariance (n, n) over [s, v, a, own private]."""

    mean: Array
    covariance: Array


class Observed(NamedTuple):
    """A reading as one scalar observation: row h over [s, v, a, own private], value z, variance R."""

    row: tuple[float, ...]
    value: float
    variance: float


class Stacked(NamedTuple):
    """A row for each of H beliefs: h (k, H), or k numbers for all, z (H), R (H); `present` (H): who has it; None: all."""

    row: Array | tuple[float, ...]
    value: Array | float
    variance: Array | float
    present: NDArray[np.bool_] | None = None


def stacked(each: Sequence[Sequence[Observed]], size: int) -> list[Stacked]:
    """The rows of one reading at H beliefs over `size` states, one beside the other."""
    out = []
    for component in range(max(map(len, each))):
        h, z, R = np.zeros((size, len(each))), np.zeros(len(each)), np.ones(len(each))
        present = np.array([component < len(found) for found in each])
        for i, found in enumerate(each):
            if present[i]:
                h[:, i], z[i], R[i] = found[component]
        out.append(Stacked(h, z, R, None if present.all() else present))
    return out
