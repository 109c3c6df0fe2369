"""Cross-induction loop: one pulse at each crossing of the loop laid along the track."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from milepost.estimation.layout import Array
from milepost.simulation.motion import Motion
from milepost.simulation.noise import BLOCK, block_rng

from .base import Belief, Measured, Observed, PeriodicSource, Sensor, SensorOptions, Source, World
from .pulses import Silence


class InductionLoopOptions(SensorOptions):
    """`pitch_std_m`: how far each pitch, as laid, is off its nominal length (one standard deviation).

    2.24 mm on 0.1 m makes 0.1 (m/s)² over 10 ms at 20 m/s, which is source A's figure, and 0.3 m rms after 2 km.
    `phase_s`: when, after each whole period, the pulses are read out.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    phase_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    pitch_m: Annotated[float, Field(gt=0.0)] = 0.1
    pitch_std_m: Annotated[float, Field(gt=0.0)] = 0.00224


class InductionLoop(Sensor[InductionLoopOptions]):
    """Speed from pulse timing: z = n p / Δt over the n pitches between the last pulses of two sampling windows.

    Stamped at mid-interval, where the mean speed equals the instantaneous one up to a'Δt²/24. Each pitch is off by
    N(0, σ²) independently, so R = n σ²/Δt² and the readings' errors add up to a position error that grows as √n.
    No pulse is an upper bound on speed, p/Δt, never zero: taken as z = p/2Δt, R = (p/2Δt)². Source: A (11).
    """

    kind = "induction_loop"
    stream = "speed_reading"
    options_model = InductionLoopOptions

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:  # noqa: ARG002
        """h = [0, 1, 0]."""
        if reading.speed_mps is None:
            middle = 0.5 * reading.speed_max_mps
            return (Observed((0.0, 1.0, 0.0), middle, middle * middle),)
        return (Observed((0.0, 1.0, 0.0), reading.speed_mps, reading.speed_variance_m2ps2),)

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated crossings of the world's motion."""
        if world is None:
            raise ValueError(f"{self.unit}: a {self.kind} has no source without a simulated world")
        return _Simulated(self.unit, self.options, world, from_s)


class Crossings:
    """Where the loop crosses: crossing k lies at k p + Σ errors of the pitches before it, a fixed property of the track."""

    def __init__(self, seed: int, unit: str, pitch_m: float, pitch_std_m: float) -> None:
        self._seed, self._unit, self._pitch, self._std = seed, unit, pitch_m, pitch_std_m
        self._block_starts = [0.0]
        self._block = -1
        self._positions: list[float] = []

    def position(self, k: int) -> float:
        """The position of crossing k ≥ 0; crossings below 0 lie on the bare pitch."""
        if k < 0:
            return k * self._pitch
        block, place = divmod(k, BLOCK)
        if block != self._block:
            while len(self._block_starts) <= block:
                n = len(self._block_starts) - 1
                self._block_starts.append(self._block_starts[n] + float(self._pitches(n).sum()))
            starts = np.concatenate([[0.0], np.cumsum(self._pitches(block)[:-1])])
            self._positions = (self._block_starts[block] + starts).tolist()
            self._block = block
        return self._positions[place]

    def _pitches(self, block: int) -> Array:
        return self._pitch + self._std * block_rng(self._seed, self._unit, block).standard_normal(BLOCK)

    def last_before(self, position_m: float) -> int:
        """The number of the last crossing at or before a position."""
        k = math.floor(position_m / self._pitch)
        while self.position(k) > position_m:
            k -= 1
        while self.position(k + 1) <= position_m:
            k += 1
        return k


class _Simulated(PeriodicSource):
    def __init__(self, unit: str, options: InductionLoopOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s, options.phase_s)
        self._motion = world.motion
        self._pitch, self._variance = options.pitch_m, options.pitch_std_m**2
        self._crossings = Crossings(world.seed, unit, options.pitch_m, options.pitch_std_m)
        self._t = self.time_of(self._index)
        self._index += 1
        self._s = self._motion.at(self._t)[0]
        self._k = self._crossings.last_before(self._s)
        self._next_m = self._crossings.position(self._k + 1)
        self._pulse_s: float | None = None
        self._silence = Silence(self._t, self.period_s)

    def sample(self, index: int, t_s: float) -> Measured | None:  # noqa: ARG002
        from_s, from_m = self._t, self._s
        self._t, (self._s, v, _) = t_s, self._motion.at(t_s)
        passed, last_m = 0, 0.0
        while self._next_m <= self._s:
            passed, last_m = passed + 1, self._next_m
            self._next_m = self._crossings.position(self._k + passed + 1)
        if not passed:
            return self._silence.bound(t_s, self._pitch)
        self._k += passed
        pulse_s = _crossed_at(self._motion, last_m, from_s, from_m, t_s, self._s, v)
        before_s, self._pulse_s = self._pulse_s, pulse_s
        self._silence.broken(pulse_s)
        if before_s is None:
            return None
        dt = pulse_s - before_s
        fields = {
            "speed_mps": passed * self._pitch / dt,
            "speed_variance_m2ps2": passed * self._variance / (dt * dt),
            "interval_s": dt,
        }
        return Measured(0.5 * (pulse_s + before_s), fields)


def _crossed_at(motion: Motion, at_m: float, t0: float, s0: float, t1: float, s1: float, v1: float) -> float:
    """The time in [t0, t1] at which the train passed `at_m`: the chord's, then one Newton step (over 10 ms: to 1e-12 s)."""
    t = t0 + (at_m - s0) / (s1 - s0) * (t1 - t0)
    s, v, _ = motion.at(t)
    t += (at_m - s) / max(v, 0.5 * v1, 1e-3)
    return min(max(t, t0), t1)
