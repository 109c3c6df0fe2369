"""How many pitches lie between two pulses, where crossings may have been missed between them."""

from __future__ import annotations

import math
from typing import NamedTuple

# that a belief says nothing of the count at all, for every count: keeps a wrong belief from confirming itself
BELIEF_WRONG = 1e-5
# misses beyond what this share of readings has are not considered
RAREST = 1e-9
# with more missed than this on average, their number is as good as normal
MANY = 30.0
# a belief so many standard deviations off does not count then
WRONG_SIGMAS = 5.0


class Faults(NamedTuple):
    """Crossings are missed with probability q; `joint` of them lack in a joint, which a pitch begins with probability π."""

    missed: float
    joint: int
    joint_probability: float


class Count(NamedTuple):
    """The number of pitches: its mean and variance."""

    mean: float
    variance: float


def pitches(seen: int, expected: float | None, expected_variance: float, pitch_ratio_variance: float, faults: Faults) -> Count:
    """How many pitches n a train passed when m pulses were seen, the last of them at its end.

    P(n = m + j) ∝ w_j (N(n̂; m + j, σ² + (m + j) r) + ε): j missed crossings are negative binomial, C(m+j-1, j) q^j (1-q)^m,
    and with probability m π a joint's more; n̂ = `expected` with variance σ² from the belief (None: there is none),
    r = `pitch_ratio_variance` of a pitch over its length; ε: see BELIEF_WRONG. A belief that is sure of the speed decides n;
    one that is not leaves a variance.
    """
    joint = min(1.0, seen * faults.joint_probability)
    if seen * faults.missed > MANY:
        return _many(seen, joint, expected, expected_variance, pitch_ratio_variance, faults)
    # relative to none missed, so that the weights of many pulses do not vanish
    weights: dict[int, float] = {}
    j, w, largest = 0, 1.0, 1.0
    while w >= RAREST * largest:
        weights[j] = weights.get(j, 0.0) + (1.0 - joint) * w
        if joint > 0.0:
            for lacking, share in ((-1, 0.25), (0, 0.5), (1, 0.25)):
                more = max(faults.joint + lacking, 0) + j
                weights[more] = weights.get(more, 0.0) + joint * share * w
        j += 1
        w *= faults.missed * (seen + j - 1) / j
        largest = max(largest, w)
    if expected is not None:
        for j in weights:
            variance = expected_variance + (seen + j) * pitch_ratio_variance
            off = (expected - seen - j) ** 2 / variance
            weights[j] *= math.exp(-0.5 * off) / math.sqrt(2.0 * math.pi * variance) + BELIEF_WRONG
    total = sum(weights.values())
    mean = sum(w * j for j, w in weights.items()) / total
    return Count(seen + mean, sum(w * (j - mean) ** 2 for j, w in weights.items()) / total)


def _many(
    seen: int, joint: float, expected: float | None, expected_variance: float, pitch_ratio_variance: float, faults: Faults
) -> Count:
    """The same by moments: n ~ N(m/(1-q) + π J, m q/(1-q)² + π (1-π) J²), times the belief's N(n̂; n, σ² + n r)."""
    seen_part = 1.0 - faults.missed
    mean = seen / seen_part + joint * faults.joint
    variance = seen * faults.missed / seen_part**2 + joint * (1.0 - joint) * faults.joint**2
    if expected is None:
        return Count(mean, variance)
    doubt = expected_variance + mean * pitch_ratio_variance
    if (expected - mean) ** 2 > WRONG_SIGMAS**2 * (variance + doubt):
        return Count(mean, variance)
    gain = variance / (variance + doubt)
    return Count(mean + gain * (expected - mean), (1.0 - gain) * variance)
