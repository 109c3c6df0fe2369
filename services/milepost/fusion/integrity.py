"""The bound that is published with the estimate."""

from __future__ import annotations

import math


def interval(value: float, variance: float, sigmas: float, accuracy: float = 0.0) -> tuple[float, float]:
    """[value - k σ - a, value + k σ + a]: k standard deviations and a fixed accuracy a (location and map) on either side.

    `variance` in the square of `value`'s unit, `accuracy` in its unit, ≥ 0. SUBSET-026 3.6.4 adds the location accuracy
    of the reference balise in the same way.
    """
    reach = sigmas * math.sqrt(max(variance, 0.0)) + accuracy
    return value - reach, value + reach
