"""Antennas that cross the loop, and the device that makes one reading of what they saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from milepost.simulation.motion import Motion

from ..pulses import legs
from .crossings import Crossings, Unseen

# an antenna that sees none while the other sees so many is over a joint: one is missed, one more may be on its way
PULSES_BEHIND = 3


class Pulses(NamedTuple):
    """What an antenna saw in a window: how many pulses, the time of the last one, and of the last one before the window.

    `lacked`: the longest run of crossings without a pulse between these. The other antenna saw as many pulses meanwhile.
    """

    passed: int
    last_s: float
    before_s: float | None
    lacked: int


class Antenna:
    """One antenna, `offset_m` ahead of the train's position; it sees crossings in both directions from time t on."""

    def __init__(self, crossings: Crossings, unseen: Unseen, motion: Motion, offset_m: float, t_s: float) -> None:
        self._crossings, self._unseen, self._motion, self._offset = crossings, unseen, motion, offset_m
        self._s, self._v, _ = motion.at(t_s)
        # the antenna is between crossings k and k + 1
        self._k = crossings.last_before(self._s + offset_m)
        self._below, self._above = crossings.position(self._k), crossings.position(self._k + 1)
        self._pulse_s: float | None = None
        # crossings without a pulse: since the last pulse, and the most between two pulses of the window
        self._unseen_since, self._lacked = 0, 0

    def look(self, from_s: float, to_s: float) -> Pulses | None:
        """The pulses of the window (from, to]; None where there was none."""
        motion, count, pulse_s = self._motion, 0, 0.0
        self._lacked = 0
        v0, (_, self._v, _) = self._v, motion.at(to_s)
        for t0, t1 in legs(motion, from_s, v0, to_s, self._v):
            s0, (s1, v1, _) = self._s, motion.at(t1)
            passed, last_m = self._passed(s1 + self._offset)
            if passed:
                count, pulse_s = count + passed, crossed_at(motion, last_m - self._offset, t0, s0, t1, s1, v1)
            self._s = s1
        if not count:
            return None
        before_s, self._pulse_s = self._pulse_s, pulse_s
        return Pulses(count, pulse_s, before_s, self._lacked)

    def _passed(self, position_m: float) -> tuple[int, float]:
        """How many crossings the antenna sees on the way to a position without turning round, and where the last one lies."""
        count, last_m = 0, 0.0
        while self._above <= position_m:
            self._k += 1
            if self._pulse(self._k):
                count, last_m = count + 1, self._above
            self._below, self._above = self._above, self._crossings.position(self._k + 1)
        while self._below > position_m:
            if self._pulse(self._k):
                count, last_m = count + 1, self._below
            self._k -= 1
            self._below, self._above = self._crossings.position(self._k), self._below
        return count, last_m

    def _pulse(self, k: int) -> bool:
        """Whether crossing k makes a pulse."""
        if k in self._unseen:
            self._unseen_since += 1
            return False
        self._lacked, self._unseen_since = max(self._lacked, self._unseen_since), 0
        return True


class Single:
    """A device with one antenna."""

    def choose(self, seen: Sequence[Pulses | None]) -> Pulses | None:
        """What the antenna saw."""
        return seen[0]


class Pair:
    """A device with two antennas: the second one's pulses where the first is over a joint.

    An antenna is over one where the other sees several pulses and it sees none in between. The mean of both would be no
    better than one: they cross the same pitches, with the same errors, one after the other.
    """

    def __init__(self) -> None:
        self._of_other = [0, 0]

    def choose(self, seen: Sequence[Pulses | None]) -> Pulses | None:
        """What a reading is made of."""
        counts = [0 if pulses is None else pulses.passed for pulses in seen]
        blind = []
        for i in (0, 1):
            self._of_other[i] += counts[1 - i]
            own = seen[i]
            blind.append((self._of_other[i] if own is None else own.lacked) >= PULSES_BEHIND)
            if own is not None:
                self._of_other[i] = 0
        if blind[0]:
            return None if blind[1] else seen[1]
        return seen[0]


def crossed_at(motion: Motion, at_m: float, t0: float, s0: float, t1: float, s1: float, v1: float) -> float:
    """The time in [t0, t1] at which the train passed `at_m`: the chord's, then one Newton step (over 10 ms: to 1e-12 s)."""
    t = t0 + (at_m - s0) / (s1 - s0) * (t1 - t0)
    s, v, _ = motion.at(t)
    t += (at_m - s) / math.copysign(max(abs(v), 0.5 * abs(v1), 1e-3), s1 - s0)
    return min(max(t, t0), t1)
