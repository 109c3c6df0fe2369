"""The simulated odometer: a wheel that wears and creeps, and two devices that compute its speed from pulses."""

from __future__ import annotations

import math
from typing import Protocol

from milepost.recordings.measured import Measured
from milepost.simulation.noise import WhiteNoise

from ..base import World
from ..periodic import PeriodicSource
from ..pulses import SHORTEST_PART, Limits, Silence, legs

# creep is integrated in steps of this; its ramps are many times as long
STEP_S = 0.02


class DeviceOptions(Protocol):
    """The parameters of a device."""

    rate_hz: float
    phase_s: float
    jitter_s: float
    timer_s: float | None
    speed_noise_std_mps: float

    @property
    def pitch_m(self) -> float: ...

    @property
    def limits(self) -> Limits: ...


class Wheel:
    """Turns by ∫ 2 v (1 + c)/D dt, c the creep, D = D_0 - wear t; counted in pulses, N a turn."""

    def __init__(self, unit: str, world: World, diameter_m: float, wear_mps: float, pulses_per_turn: int) -> None:
        self._unit, self._motion, self._creep = unit, world.motion, world.creep
        self._diameter_m, self._wear_mps, self._pulses_per_turn = diameter_m, wear_mps, pulses_per_turn

    def diameter_m(self, t_s: float) -> float:
        """The true diameter; a wheel is never worn to less than half."""
        return max(self._diameter_m - self._wear_mps * t_s, 0.5 * self._diameter_m)

    def pulses_at(self, t_s: float) -> float:
        """The wheel's angle in pulses when the device is switched on; the creep before it is not known."""
        return self._motion.at(t_s)[0] * self._pulses_per_turn / (math.pi * self.diameter_m(t_s))

    def turned(self, from_s: float, to_s: float) -> float:
        """Pulses, and parts of one, between two times: the path is exact, the creep's part by Simpson's rule."""
        path = self._motion.at(to_s)[0] - self._motion.at(from_s)[0] + self._crept(from_s, to_s)
        return path * self._pulses_per_turn / (math.pi * self.diameter_m(0.5 * (from_s + to_s)))

    def legs(self, from_s: float, to_s: float) -> list[tuple[float, float]]:
        """The time in between, split where the wheel turns round with the train."""
        return legs(self._motion, from_s, self._motion.at(from_s)[1], to_s, self._motion.at(to_s)[1])

    def _crept(self, from_s: float, to_s: float) -> float:
        if self._creep is None or to_s <= from_s:
            return 0.0
        steps = 2 * math.ceil((to_s - from_s) / (2.0 * STEP_S))
        h = (to_s - from_s) / steps
        total = 0.0
        for i in range(steps + 1):
            t = from_s + i * h
            c = self._creep.at(self._unit, t)
            if c:
                total += (1.0 if i in (0, steps) else 4.0 if i % 2 else 2.0) * c * self._motion.at(t)[1]
        return total * h / 3.0


class _Device(PeriodicSource):
    """Samples at the grid times, each off by its own uniform error within ± `jitter_s`."""

    def __init__(self, unit: str, wheel: Wheel, options: DeviceOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s, options.phase_s)
        self._wheel = wheel
        self._pitch_m, self._limits = options.pitch_m, options.limits
        self._jitter_s = min(options.jitter_s, 0.49 * self.period_s)
        self._noise_std = options.speed_noise_std_mps
        self._noise = WhiteNoise(world.seed, unit)
        self._jitter = WhiteNoise(world.seed, f"{unit}.jitter")
        self._t = self.time_of(self._index)
        self._index += 1
        self._pulses = wheel.pulses_at(self._t)

    def time_of(self, index: int) -> float:
        """The true time of a sample; never before the motion begins."""
        t = super().time_of(index)
        if self._jitter_s:
            # the normal distribution function makes a uniform number of a normal one
            t += self._jitter_s * math.erf(self._jitter[index] / math.sqrt(2.0))
        return max(t, 0.0)

    def _reading(self, index: int, measured_s: float, speed: float, variance: float, interval_s: float) -> Measured:
        white = variance + self._noise_std**2
        fields = {
            "speed_mps": speed + self._noise_std * self._noise[index],
            "speed_variance_m2ps2": self._limits.mean_variance(white, interval_s),
            "interval_s": interval_s,
        }
        return Measured(measured_s, fields)


class TimedPulses(_Device):
    """v = q n/Δt between the last edges of two samples, each timed to τ: n is exact, R = v² τ²/(6 Δt²) + noise + e².

    q = π D/N at the nominal diameter. Two channels give the direction, so n is signed and counts reversals. Stamped at
    mid-interval, where the mean speed equals the speed up to e = J Δt²/24. After a bound, Δt is what is left of the interval,
    and R grows by q²/(3 Δt²). The difference of two errors uniform over τ has the variance τ²/6. Source: D (1), with the
    interval measured instead of assumed.
    """

    def __init__(self, unit: str, wheel: Wheel, options: DeviceOptions, world: World, from_s: float) -> None:
        super().__init__(unit, wheel, options, world, from_s)
        self._timer_s = options.timer_s or 0.0
        self._edge: tuple[int, float] | None = None
        self._silence = Silence(self._t, self._pitch_m, options.limits)

    def sample(self, index: int, t_s: float) -> Measured | None:
        """The mean speed between the last edges; a bound where there has been no edge for the length of a window."""
        from_s, self._t = self._t, t_s
        edge = None
        for t0, t1 in self._wheel.legs(from_s, t_s):
            edge = self._last_edge(t0, t1) or edge
        if edge is None:
            return self._silence.bound(t_s)
        last, self._edge = self._edge, edge
        self._silence.broken(edge[1] + self._timer_s)
        if last is None:
            return None
        begin_s, doubt_m2 = self._silence.rest(last[1])
        dt = edge[1] - begin_s
        if dt < SHORTEST_PART * self.period_s:
            return None
        speed = self._pitch_m * (edge[0] - last[0]) / dt
        variance = (speed * self._timer_s / dt) ** 2 / 6.0 + doubt_m2 / (dt * dt)
        return self._reading(index, begin_s + 0.5 * dt, speed, variance, dt)

    def _last_edge(self, from_s: float, to_s: float) -> tuple[int, float] | None:
        """Number and time of the last edge that the wheel passes without turning round; None where it passes none."""
        before, turned = self._pulses, self._wheel.turned(from_s, to_s)
        self._pulses = before + turned
        if math.floor(self._pulses) == math.floor(before):
            return None
        # going backwards, the last edge passed is the one above
        number = math.floor(self._pulses) + (turned < 0.0)
        return number, math.floor(self._when(number - before, turned, from_s, to_s) / self._timer_s) * self._timer_s

    def _when(self, pulses: float, turned: float, from_s: float, to_s: float) -> float:
        """The time at which the wheel has turned by `pulses` since `from_s`: the chord's, then three secant steps."""
        t, rate = from_s + pulses / turned * (to_s - from_s), turned / (to_s - from_s)
        for _ in range(3):
            t = min(max(t + (pulses - self._wheel.turned(from_s, t)) / rate, from_s), to_s)
        return t


# of a count, in pulses²: the largest
COUNT_VARIANCE = 0.25


class CountedPulses(_Device):
    """v = q Δn/T with the nominal period T: R = q²/(4 T²) + 2 σ_j² v²/T² + noise.

    A count of an interval of random phase that holds x pulses errs with variance f(1 - f), f the fraction of x: at most 1/4,
    and at a constant speed f stays. σ_j² = jitter²/3: both ends of the interval are off. Successive errors cancel (each end
    is shared), so that as white errors they are overstated rather than understated. A count of zero is a bound over the period,
    which both jitters may have shortened. Source: D (1).
    """

    def __init__(self, unit: str, wheel: Wheel, options: DeviceOptions, world: World, from_s: float) -> None:
        super().__init__(unit, wheel, options, world, from_s)
        nominal_s = self._index / options.rate_hz + options.phase_s - self.period_s
        # a window for each count of zero: it must weigh as much as a count of one, or their mean would not be the speed
        self._silence = Silence(nominal_s, self._pitch_m, options.limits, self.period_s)

    def sample(self, index: int, t_s: float) -> Measured | None:
        """The speed from the pulses counted in a period; a bound where there were none."""
        before = math.floor(self._pulses)
        self._pulses += self._wheel.turned(self._t, t_s)
        self._t = t_s
        T = self.period_s
        nominal_s = index * T + self._phase_s
        count = math.floor(self._pulses) - before
        if not count:
            return self._silence.bound(nominal_s, less_s=2.0 * self._jitter_s)
        self._silence.broken(nominal_s)
        speed = self._pitch_m * count / T
        variance = COUNT_VARIANCE * (self._pitch_m / T) ** 2 + 2.0 / 3.0 * (self._jitter_s * speed / T) ** 2
        return self._reading(index, nominal_s - 0.5 * T, speed, variance, T)
