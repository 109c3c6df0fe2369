"""What the innovations of a unit say against a hypothesis: tests of one reading and of the last 8, 64 and 512."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.layout import Array

Flags = NDArray[np.bool_]
# the lengths in readings of the windows of e and of e²; a window forgets as λᵏ with λ = 1 - 1/length, that of one at once
MEANS, SQUARES = (1.0, 8.0, 64.0, 512.0), (8.0, 64.0, 512.0)
WINDOWS = (*MEANS, *SQUARES)
LAMBDAS = 1.0 - 1.0 / np.array(WINDOWS)
FORGET = LAMBDAS[:, None]
M = len(MEANS)
# the names of the tests, one for each window
TESTS = ("jumping", *("biased",) * (M - 1), *("noisy",) * len(SQUARES))
# what is found without them
STUCK, OUT_OF_RANGE = len(TESTS), len(TESTS) + 1
KINDS = (*TESTS, "stuck", "out of range")
# a unit that says the same so many times over is stuck
REPEATS = 4
# beyond so many readings the longest window no longer changes
FULL = 16 * int(max(WINDOWS))
# a few readings: what they tell is sudden
SHORT = 8
SECONDS_PER_HOUR = 3600.0


def threshold(false_alarms_per_hour: float, readings_per_s: float) -> float:
    """The normal deviate k that all tests of a train exceed by chance `false_alarms_per_hour` times an hour at most.

    2 Φ(-k) = α / (3600 f m): f readings a second of the whole train, m tests on each. Neighbouring windows overlap, so the
    true rate is lower.
    """
    tests = SECONDS_PER_HOUR * max(readings_per_s, 1e-3) * len(TESTS)
    return -NormalDist().inv_cdf(min(0.25, 0.5 * false_alarms_per_hour / tests))


def _weights(count: Any) -> tuple[Array, Array]:
    """Σλᵏ and Σλ²ᵏ over `count` readings, one number or a column."""
    return (1.0 - LAMBDAS**count) / (1.0 - LAMBDAS), (1.0 - LAMBDAS ** (2 * count)) / (1.0 - LAMBDAS**2)


def _scales() -> Array:
    """For 1, 2 … `FULL` readings: 1/√Σλ²ᵏ, 1/Σλᵏ; 1 - 2/9ν and 1/√(2/9ν) of Wilson and Hilferty; shape (4, 7, `FULL`)."""
    weights, squares = _weights(np.arange(1, FULL + 1)[:, None])
    spread = 2.0 / 9.0 * squares / weights**2
    scales = np.stack([1.0 / np.sqrt(squares), 1.0 / weights, 1.0 - spread, 1.0 / np.sqrt(spread)])
    return np.ascontiguousarray(scales.swapaxes(1, 2))


# computing them for each reading would cost as much as the tests themselves
SCALES = _scales()


def extended(sums: Array, e: Array) -> Array:
    """The sums (7, H) over the windows, Σλᵏe and Σλᵏe², after one more normalised innovation e (H)."""
    out: Array = sums * FORGET
    # `out[:M] += e` would copy the slice onto itself
    means, squares = out[:M], out[M:]
    means += e
    squares += e * e
    return out


def statistics(sums: Array, count: Any) -> Array:
    """The tests (7, H), each N(0, 1) or |N(0, 1)| under its hypothesis: the innovation, its means, its mean squares.

    |Σλᵏe|/√Σλ²ᵏ, for a window of one |e|; and Wilson and Hilferty's ((q/Σλᵏ)^⅓ - 1 + 2/9ν)/√(2/9ν) with q = Σλᵏe² and
    ν = (Σλᵏ)²/Σλ²ᵏ degrees of freedom. `count`: the number of innovations in the sums, one or of each (H).
    """
    root, weight, offset, sharp = SCALES[:, :, np.minimum(np.atleast_1d(count), FULL) - 1]
    out = np.empty_like(sums)
    out[:M] = np.abs(sums[:M]) * root[:M]
    out[M:] = (np.cbrt(sums[M:] * weight[M:]) - offset[M:]) * sharp[M:]
    return out


def unheard(sums: Array, count: int, common: float) -> Array:
    """`statistics` of a unit that the rows do not hear: a part ρ of the innovations' variance may be one error in `common`.

    |Σλᵏe|/√((1 - ρ) Σλ²ᵏ + ρ (Σλᵏ)²); and the mean squares about the mean, (Σλᵏe²/Σλᵏ - (Σλᵏe/Σλᵏ)²) ν/(ν - 1), of ν - 1
    degrees of freedom, into which a common error does not enter.
    """
    count = min(count, FULL)
    weights, squares = _weights(count)
    freedom = weights**2 / squares
    means = sums / weights[:, None]
    out = np.zeros_like(sums)
    out[:M] = np.abs(means[:M]) / np.sqrt((1.0 - common) / freedom[:M] + common)[:, None]
    if count > 1:
        left = freedom[M:, None] - 1.0
        about = np.maximum(means[M:] - means[1:M] ** 2, 0.0) * freedom[M:, None] / left
        spread = 2.0 / 9.0 / left
        out[M:] = (np.cbrt(about) - 1.0 + spread) / np.sqrt(spread)
    return out


class Bounds:
    """The sums (7) at which the tests reach `limit`: comparing sums is a tenth of the work of `statistics`."""

    def __init__(self, limit: float) -> None:
        root, weight, offset, sharp = SCALES.swapaxes(1, 2)
        bounds = np.where(np.arange(len(WINDOWS)) < M, limit / root, (limit / sharp + offset) ** 3 / weight)
        self._bounds = bounds[:, :, None]

    def of(self, counts: list[int]) -> Array:
        """The bounds (7, C) of C sums, of so many readings each."""
        table: Array = self._bounds[:, :, 0].T
        return table[:, np.minimum(counts, FULL) - 1]

    def exceeded(self, sums: Array, count: int) -> Flags:
        """Which of the tests (7, H) exceed the limit; the same as `statistics(sums, count) > limit`."""
        return np.asarray(np.abs(sums) > self._bounds[min(count, FULL) - 1])


def window_of(test: int) -> int:
    """The number of readings that a test looks at."""
    return int(WINDOWS[test]) if test < len(TESTS) else 1


def worst_by_chance(worst: Array, tests: Array) -> Array:
    """1 - (1 - 2 Φ(-k))ᵐ: the probability that the worst of m tests (H) is at least k (H) by chance; 1 without any test."""
    one = np.array([math.erfc(k * 0.5**0.5) for k in worst])
    return np.asarray(np.where((tests == 0) | (one >= 1.0), 1.0, -np.expm1(tests * np.log1p(-np.minimum(one, 0.999)))))


@cache
def usual(tests: int) -> Bounds:
    """What the worst of so many tests stays below by chance in 9 of 10 cases: 1 - (1 - 2 Φ(-k))ᵐ = 1/10."""
    # a little less, so that a rounding error never takes what is rarer for usual
    return Bounds(normal_reach(-math.expm1(math.log(0.9) / tests)) - 1e-9)


def normal_reach(risk: float) -> float:
    """K with 2 Φ(-K) = risk; at least 1."""
    return max(1.0, -NormalDist().inv_cdf(min(0.5, max(0.5 * risk, math.ulp(0.0)))))
