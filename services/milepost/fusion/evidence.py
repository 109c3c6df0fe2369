"""What the innovations of a unit say against a hypothesis: tests of one reading and of the last 8, 64 and 512."""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from milepost.estimation.layout import Array

# the lengths of the windows in readings; a window forgets as λᵏ with λ = 1 - 1/length
WINDOWS = (8.0, 64.0, 512.0)
LAMBDAS = np.array([1.0 - 1.0 / length for length in WINDOWS])
# the sums of e and of e², each in every window
SUMS = 2 * len(WINDOWS)
FORGET = np.concatenate([LAMBDAS, LAMBDAS])
# the names of the tests, in the order of `statistics`
TESTS = ("jumping", *("biased",) * len(WINDOWS), *("noisy",) * len(WINDOWS))
# what is found without them
STUCK, OUT_OF_RANGE = len(TESTS), len(TESTS) + 1
KINDS = (*TESTS, "stuck", "out of range")
# a unit that says the same so many times over is stuck
REPEATS = 4
# beyond so many readings the longest window no longer changes
FULL = 16 * int(WINDOWS[-1])
SECONDS_PER_HOUR = 3600.0


def threshold(false_alarms_per_hour: float, readings_per_s: float) -> float:
    """The normal deviate k that all tests of a train exceed by chance `false_alarms_per_hour` times an hour at most.

    2 Φ(-k) = α / (3600 f m): f readings a second of the whole train, m tests on each. Neighbouring windows overlap, so the
    true rate is lower.
    """
    tests = SECONDS_PER_HOUR * max(readings_per_s, 1e-3) * len(TESTS)
    return -NormalDist().inv_cdf(min(0.25, 0.5 * false_alarms_per_hour / tests))


@lru_cache(maxsize=FULL + 1)
def _scales(count: int) -> tuple[Array, Array, Array, Array]:
    """For `count` readings: 1/√Σλ²ᵏ, 1/Σλᵏ, and the offset 1 - 2/9ν and 1/√(2/9ν) of Wilson and Hilferty."""
    squares = (1.0 - LAMBDAS ** (2 * count)) / (1.0 - LAMBDAS**2)
    weights = (1.0 - LAMBDAS**count) / (1.0 - LAMBDAS)
    spread = 2.0 / 9.0 * squares / weights**2
    return 1.0 / np.sqrt(squares), 1.0 / weights, 1.0 - spread, 1.0 / np.sqrt(spread)


def extended(sums: Array, e: Array) -> Array:
    """The sums (H, 6) over the windows after one more normalised innovation e (H)."""
    column = e[:, None]
    out: Array = sums * FORGET
    out[:, : len(WINDOWS)] += column
    out[:, len(WINDOWS) :] += column * column
    return out


def statistics(sums: Array, e: Array, count: int) -> Array:
    """The tests (H, 7), each N(0, 1) or |N(0, 1)| under its hypothesis: the innovation, its means, its mean squares.

    |e|; |Σλᵏe|/√Σλ²ᵏ; and Wilson and Hilferty's ((q/Σλᵏ)^⅓ - 1 + 2/9ν)/√(2/9ν) with q = Σλᵏe² and ν = (Σλᵏ)²/Σλ²ᵏ degrees
    of freedom. `sums` hold this innovation already; `count`: the number of innovations in them.
    """
    root, weight, offset, sharp = _scales(min(count, FULL))
    k = len(WINDOWS)
    out = np.empty((len(e), 1 + SUMS))
    out[:, 0] = np.abs(e)
    out[:, 1 : 1 + k] = np.abs(sums[:, :k]) * root
    out[:, 1 + k :] = (np.cbrt(sums[:, k:] * weight) - offset) * sharp
    return out


def window_of(test: int) -> int:
    """The number of readings that a test looks at."""
    return 1 if not 0 < test < len(TESTS) else int(WINDOWS[(test - 1) % len(WINDOWS)])


def normal_reach(risk: float) -> float:
    """K with 2 Φ(-K) = risk; at least 1."""
    return max(1.0, -NormalDist().inv_cdf(min(0.5, max(0.5 * risk, math.ulp(0.0)))))
