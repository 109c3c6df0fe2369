"""Which way the train goes over the loop: pulses do not say."""

from __future__ import annotations

import math

from ..base import Belief, Observed
from .options import SIGMAS

SPEED = (0.0, 1.0, 0.0)
# e^x to 1 that a sign is right, from which on it is taken as known
CERTAIN = 30.0
# an observation that takes less than this part of the variance away is none
LEAST_NEWS = 1e-3


class Reversals:
    """Says of each interval between pulses whether the train may have turned round in it, from the pulses before it alone.

    A train that turns round passes the same crossing twice: n pulses in Δ are then not n pitches. It cannot have, within
    accelerations of A at most, where it was too fast at the beginning, l > A Δ, l = n p/Δ - A Δ/2 the least speed that the
    interval before ended with, or where it could not even from standstill get so far, (n - 1) p > A Δ²/2, in this interval
    or in it and the one before. 0.1 m and 1.5 m/s²: a train that slows down is lost below 0.47 m/s, one that speeds up is
    found from 0.55 m/s on.
    """

    def __init__(self, pitch_m: float, pitch_std_m: float, acceleration_mps2: float) -> None:
        self._pitch_m, self._std_m, self._A = pitch_m, pitch_std_m, acceleration_mps2
        self._least_mps = 0.0
        self._before = (0, 0.0)

    def excluded(self, pulses: int, interval_s: float) -> bool:
        """Whether the train went one way through the next interval."""
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
        """The least length of so many pitches as laid."""
        return pitches * self._pitch_m - SIGMAS * self._std_m * math.sqrt(pitches)


def signed(speed_mps: float, variance_m2ps2: float, belief: Belief | None) -> tuple[Observed, ...]:
    """|v| = z + e, e ~ N(0, R), as an observation of v: z with the sign that the belief decides.

    Against N(v̂, P) both signs are possible, +z : -z as e^x : 1 with x = 2 z v̂/(P + R). The result has the mean and
    variance of what is then known of v: that of both together. Where one sign is out of the question, that is z or -z with
    R; where neither is and both lie within what is believed, nothing. A negative z tells its sign. Source: ours.
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
    if variance >= (1.0 - LEAST_NEWS) * P:
        return ()
    equivalent = 1.0 / (1.0 / variance - 1.0 / P)
    return (Observed(SPEED, v + (mean - v) * (equivalent + P) / P, equivalent),)
