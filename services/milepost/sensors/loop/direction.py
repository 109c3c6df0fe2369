"""Which way the train crosses the loop: pulses do not tell."""

from __future__ import annotations

import math

import numpy as np

from milepost.estimation.beliefs import Beliefs

from ..observed import Belief, Observed, Stacked
from .options import SIGMAS

SPEED = (0.0, 1.0, 0.0)
# a sign is taken as known when the other one is less likely by this power of e
CERTAIN = 30.0
# an observation that would reduce the variance by less than this part is left out
LEAST_REDUCTION = 1e-3


class Reversals:
    """Tells for each interval between pulses whether the train may have turned round in it, from the pulses alone.

    A train that turns round passes a crossing twice, so that n pulses are not n pitches. With accelerations of at most A it
    cannot turn round in an interval Δ
    - whose initial speed was too high: l > A Δ, where l = n p/Δ - A Δ/2 is the least speed at the end of the interval before;
    - in which even a start from rest would not have got so far: (n - 1) p > A Δ²/2, in Δ or in Δ and the interval before.
    For 0.1 m and 1.5 m/s² the direction is lost below 0.47 m/s and found again above 0.55 m/s. Source: ours.
    """

    def __init__(self, pitch_m: float, pitch_std_m: float, acceleration_mps2: float) -> None:
        self._pitch_m, self._std_m, self._A = pitch_m, pitch_std_m, acceleration_mps2
        self._least_mps = 0.0
        self._before = (0, 0.0)

    def excluded(self, pulses: int, interval_s: float) -> bool:
        """Whether the train cannot have turned round in the next interval Δ with its n pulses."""
        lost_mps = self._A * interval_s
        together = pulses + self._before[0], interval_s + self._before[1]
        one_way = self._least_mps > lost_mps or any(
            self._length_m(n) - self._pitch_m > 0.5 * self._A * dt * dt for n, dt in ((pulses, interval_s), together)
        )
        self._before = pulses, interval_s
        least_mps = self._length_m(pulses) / interval_s - 0.5 * lost_mps
        self._least_mps = max(least_mps, self._least_mps - lost_mps) if one_way else 0.0
        return one_way

    def _length_m(self, pitches: int) -> float:
        """The least length of n pitches as laid."""
        return pitches * self._pitch_m - SIGMAS * self._std_m * math.sqrt(pitches)


def signed(speed_mps: float, variance_m2ps2: float, belief: Belief | None) -> tuple[Observed, ...]:
    """|v| = z + e, e ~ N(0, R), as an observation of v; the belief N(v̂, P) decides the sign.

    The odds of +z against -z are e^x : 1, x = 2 z v̂/(P + R). If one sign is certain, the observation is z or -z with R.
    Otherwise it is the one that takes the belief to the mean and variance of both possibilities together, weighted by their
    odds; none if that variance is not less than P. A negative z tells its own sign. `speed_mps` z, `variance_m2ps2` R.
    Source: ours.
    """
    z, R = speed_mps, variance_m2ps2
    if belief is None or z < 0.0:
        return (Observed(SPEED, z, R),)
    v, P = float(belief.mean[1]), float(belief.covariance[1, 1])
    x = 2.0 * z * v / (P + R)
    if abs(x) >= CERTAIN:
        return (Observed(SPEED, math.copysign(z, v), R),)
    share, gain = 1.0 / (1.0 + math.exp(-x)), P / (P + R)
    mean = v + gain * ((2.0 * share - 1.0) * z - v)
    variance = gain * R + 4.0 * share * (1.0 - share) * (gain * z) ** 2
    if variance >= (1.0 - LEAST_REDUCTION) * P:
        return ()
    equivalent = 1.0 / (1.0 / variance - 1.0 / P)
    return (Observed(SPEED, v + (mean - v) * (equivalent + P) / P, equivalent),)


def signed_each(speed_mps: float, variance_m2ps2: float, beliefs: Beliefs) -> Stacked | None:
    """`signed` at each of H beliefs, where every one of them knows the sign; None where one does not."""
    z, R = speed_mps, variance_m2ps2
    if z < 0.0:
        return Stacked(SPEED, z, R)
    v = beliefs.mean(1)
    if (np.abs(2.0 * z * v) < CERTAIN * (beliefs.covariance(1, 1) + R)).any():
        return None
    return Stacked(SPEED, np.copysign(z, v), R)
