"""What pulse sensors have in common: what an interval between pulses tells of the speed, and what silence tells."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

from pydantic import Field

from milepost.recordings.measured import Measured
from milepost.simulation.motion import Motion

from .base import Pause, SensorOptions

# the least bound that a reading can state
LEAST_BOUND_MPS = 1e-3
# pulses closer in time than this part of a period mean that the train turned round on an edge: they give no value
SHORTEST_PART = 0.1
# a mid-interval error whose square is less than this part of the variance is left out
NEGLIGIBLE = 1e-3
# 38.4^(1/6): the window length whose bounds together carry the most information, in units of (d/J)^(1/3)
BEST_WINDOW = 1.84


class PulseOptions(SensorOptions):
    """`acceleration_max_mps2`, `jerk_max_mps3`: the most that the train can do, braking included.

    Only through them does an interval tell anything of the speed at its middle. The defaults are those of an emergency brake.
    """

    acceleration_max_mps2: Annotated[float, Field(gt=0.0, le=50.0)] = 1.5
    jerk_max_mps3: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0

    @property
    def limits(self) -> Limits:
        """The most that the train can do."""
        return Limits(self.acceleration_max_mps2, self.jerk_max_mps3)


class Limits(NamedTuple):
    """The largest acceleration A and jerk J of a train, either way."""

    acceleration_mps2: float
    jerk_mps3: float

    def speed_bound(self, path_m: float, interval_s: float) -> float:
        """The largest |v| in the middle of an interval Δ in which the train stayed on a stretch of length d, in m/s.

        d/Δ + A Δ/4 up to Δ = 2 √(d/A), √(d A) from there on: the fastest course rises at A to the middle and falls at A.
        Source: ours.
        """
        A = self.acceleration_mps2
        if interval_s >= 2.0 * math.sqrt(path_m / A):
            return math.sqrt(path_m * A)
        return path_m / interval_s + 0.25 * A * interval_s

    def path_m(self, bound_mps: float, interval_s: float) -> float:
        """The d of a `speed_bound` over Δ, in m."""
        A = self.acceleration_mps2
        if bound_mps <= 0.5 * A * interval_s:
            return bound_mps * bound_mps / A
        return (bound_mps - 0.25 * A * interval_s) * interval_s

    def mean_variance(self, white: float, interval_s: float) -> float:
        """The variance of a mean speed over Δ, taken as the speed at mid-interval: R + e², e = J Δ²/24, in (m/s)².

        At constant acceleration the two are equal; white jerk of density q would add q Δ³/320. `white` R, the variance of
        the mean itself. e² is left out where it is less than a thousandth of R, as in every interval of a running train.
        """
        e = self.jerk_mps3 * interval_s * interval_s / 24.0
        return white + e * e if e * e >= NEGLIGIBLE * white else white

    def bound_variance(self, bound_mps: float, interval_s: float, part: float = 1.0 / 3.0) -> float:
        """The variance of the observation v = 0 that stands for |v| < b at the middle of Δ, in (m/s)².

        The mean speed is at most d/Δ, so R = c (d/Δ)² + e², and never more than b²/3. `part` c: 1/3 for a window that begins
        at a pulse, whose end is uniform over a pitch.
        """
        at_most = bound_mps * bound_mps / 3.0
        if interval_s <= 0.0:
            return at_most
        mean = self.path_m(bound_mps, interval_s) / interval_s
        e = self.jerk_mps3 * interval_s * interval_s / 24.0
        return min(at_most, part * mean * mean + e * e)

    def window_s(self, path_m: float) -> float:
        """The length of window whose bounds carry the most information, in s.

        A window Δ gives one observation with the variance R of `bound_variance`; R Δ is least at Δ⁶ = 38.4 d²/J². The bound
        itself is lowest from Δ = 2 √(d/A) on.
        """
        return max(2.0 * math.sqrt(path_m / self.acceleration_mps2), BEST_WINDOW * math.cbrt(path_m / self.jerk_mps3))

    def pause(self, path_m: float) -> Pause:
        """How long a device may be unheard: 2.5 windows, below the speed v = √(2 A d) of a train that came from rest.

        A reading is true half a window before it is sent; the next one comes a window later, two where a pulse between them
        tells nothing. A train at √(2 A d) or more has passed a pulse since it could have stood. Source: ours.
        """
        return Pause(2.5 * self.window_s(path_m), math.sqrt(2.0 * self.acceleration_mps2 * path_m))


class Silence:
    """Windows without a pulse, end to end, with one bound each.

    Windows do not overlap, and the interval to the next pulse is measured from the end of the last window. So nothing is
    stated twice, and bounds and values add up to the pitches counted: a creeping train is not taken for a standing one.
    """

    def __init__(self, since_s: float, pitch_m: float, limits: Limits, window_s: float | None = None) -> None:
        self._pitch_m, self._limits = pitch_m, limits
        self._window_s = limits.window_s(pitch_m) if window_s is None else window_s
        self._since_s, self._stated_s = since_s, -math.inf

    def broken(self, at_s: float) -> None:
        """A pulse came."""
        self._since_s = at_s

    def bound(self, t_s: float, less_s: float = 0.0) -> Measured | None:
        """The bound of the window that ends at t, true at its middle; None while the window is too short.

        `less_s`: by how much the window may be shorter than it seems to the device.
        """
        long_s = t_s - self._since_s
        if long_s < self._window_s * (1.0 - 1e-9):
            return None
        self._since_s = self._stated_s = t_s
        bound = max(self._limits.speed_bound(self._pitch_m, long_s - less_s), LEAST_BOUND_MPS)
        return Measured(t_s - 0.5 * long_s, {"speed_max_mps": bound, "interval_s": long_s - less_s})

    def rest(self, pulse_s: float) -> tuple[float, float]:
        """(start in s, variance in m²) of the interval that follows a pulse, shortened by the windows stated since.

        After a window the train may be anywhere in a pitch: p²/3.
        """
        if self._stated_s <= pulse_s:
            return pulse_s, 0.0
        return self._stated_s, self._pitch_m * self._pitch_m / 3.0


def legs(motion: Motion, from_s: float, from_mps: float, to_s: float, to_mps: float) -> list[tuple[float, float]]:
    """[from, to] in s, split at the time when the train turns round if the speeds at its ends have opposite signs."""
    if from_mps * to_mps >= 0.0:
        return [(from_s, to_s)]
    turn_s = _falls_through(lambda t: motion.at(t)[1] * from_mps, from_s, to_s)
    return [(from_s, turn_s), (turn_s, to_s)]


def _falls_through(f: Callable[[float], float], low: float, high: float) -> float:
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f(middle) > 0.0 else (low, middle)
    return low
