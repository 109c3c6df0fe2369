"""Cross-induction loop: one pulse at each crossing of the loop laid along the track."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from milepost.recordings.measured import Measured, Source

from ..base import Belief, Observed, PeriodicSource, Sensor, SensorOptions, World
from ..pulses import Silence
from .antenna import Antenna, Pair, Single
from .count import Faults, pitches
from .crossings import Crossings, Unseen

# so rare are more misses in a row than a bound allows for
NEVER = 1e-6
SPEED = (0.0, 1.0, 0.0)


class InductionLoopOptions(SensorOptions):
    """`pitch_std_m`: how far each pitch, as laid, is off its nominal length (one standard deviation).

    2.24 mm on 0.1 m makes 0.1 (m/s)² over 10 ms at 20 m/s, which is source A's figure, and 0.3 m rms after 2 km.
    `phase_s`: when, after each whole period, the pulses are read out.
    `missed_probability`: of each crossing. Joints without crossings, `joint_length_m` long, lie at each multiple of
    `joint_every_m`. `antennas: 2`: a second one `antenna_spacing_m` behind the first bridges them.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    phase_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    pitch_m: Annotated[float, Field(ge=1e-3)] = 0.1
    pitch_std_m: Annotated[float, Field(gt=0.0)] = 0.00224
    missed_probability: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    joint_every_m: Annotated[float, Field(gt=0.0)] | None = None
    joint_length_m: Annotated[float, Field(gt=0.0)] = 1.0
    antennas: Literal[1, 2] = 1
    antenna_spacing_m: Annotated[float, Field(gt=0.0)] = 2.0

    @model_validator(mode="after")
    def _one_antenna_is_always_over_the_loop(self) -> InductionLoopOptions:
        every, length = self.joint_every_m, self.joint_length_m
        if every is None:
            return self
        if length >= 0.5 * every:
            raise ValueError("joint_length_m must be less than half of joint_every_m")
        if self.antennas == 2 and not length < self.antenna_spacing_m < every - length:
            raise ValueError("antenna_spacing_m must be such that both antennas are never over a joint at once")
        return self

    @property
    def faults(self) -> Faults | None:
        """What can make a reading's count of pitches too low; None where nothing can."""
        bare = self.joint_every_m is not None and self.antennas == 1
        if self.missed_probability == 0.0 and not bare:
            return None
        every = self.joint_every_m if bare else None
        return Faults(
            self.missed_probability,
            round(self.joint_length_m / self.pitch_m),
            0.0 if every is None else self.pitch_m / every,
        )


class InductionLoop(Sensor[InductionLoopOptions]):
    """Speed from pulse timing: z = n p / Δt over the n pitches between the last pulses of two sampling windows.

    Stamped at mid-interval, where the mean speed equals the instantaneous one up to a'Δt²/24. Each pitch is off by
    N(0, σ²) independently, so R = n σ²/Δt² and the readings' errors add up to a position error that grows as √n.
    No pulse is an upper bound on speed, p/Δt, never zero: taken as z = p/2Δt, R = (p/2Δt)². Source: A (11).

    A missed crossing makes one reading of n pitches say m = n - 1, and the position one pitch too low until the next fix.
    Where crossings can be missed, n comes from m and the belief's speed (see `count`): z = E[n] p/Δt,
    R = E[n] σ²/Δt² + Var[n] p²/Δt²; and a bound allows for the misses and the joint that silence may hide.
    """

    kind = "induction_loop"
    stream = "speed_reading"
    options_model = InductionLoopOptions

    @property
    def needs_belief(self) -> bool:
        """Where crossings can be missed, to say how many."""
        return self.options.faults is not None

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """h = [0, 1, 0]."""
        faults = self.options.faults
        if reading.speed_mps is None:
            hidden_m = 0.0 if faults is None else self._hidden_m(faults)
            middle = 0.5 * reading.speed_max_mps * (1.0 + hidden_m / self.options.pitch_m)
            return (Observed(SPEED, middle, middle * middle),)
        if faults is None or reading.interval_s <= 0.0:
            return (Observed(SPEED, reading.speed_mps, reading.speed_variance_m2ps2),)
        pitch, std, dt = self.options.pitch_m, self.options.pitch_std_m, reading.interval_s
        seen = max(1, round(reading.speed_mps * dt / pitch))
        expected, variance = None, 0.0
        if belief is not None:
            expected = float(belief.mean[1]) * dt / pitch
            variance = float(belief.covariance[1, 1]) * (dt / pitch) ** 2
        n = pitches(seen, expected, variance, (std / pitch) ** 2, faults)
        return (Observed(SPEED, n.mean * pitch / dt, (n.mean * std * std + n.variance * pitch * pitch) / (dt * dt)),)

    def _hidden_m(self, faults: Faults) -> float:
        misses = math.ceil(math.log(NEVER) / math.log(faults.missed)) if faults.missed > 0.0 else 0
        joint = self.options.joint_length_m if faults.joint_probability > 0.0 else 0.0
        return misses * self.options.pitch_m + joint

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated crossings of the world's motion."""
        world = self.needed(world)
        return _Simulated(self.unit, self.options, world, from_s)


class _Simulated(PeriodicSource):
    def __init__(self, unit: str, options: InductionLoopOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s, options.phase_s)
        self._motion = world.motion
        self._pitch, self._variance = options.pitch_m, options.pitch_std_m**2
        self._t = self.time_of(self._index)
        self._index += 1
        self._s = self._motion.at(self._t)[0]
        self._antennas = [
            Antenna(
                Crossings(world.seed, unit, options.pitch_m, options.pitch_std_m),
                Unseen(
                    world.seed,
                    f"{unit}.{i}",
                    options.pitch_m,
                    options.missed_probability,
                    options.joint_every_m,
                    options.joint_length_m,
                ),
                world.motion,
                -i * options.antenna_spacing_m,
                self._s,
            )
            for i in range(options.antennas)
        ]
        self._device = Single() if options.antennas == 1 else Pair()
        self._silence = Silence(self._t, self.period_s)

    def sample(self, index: int, t_s: float) -> Measured | None:  # noqa: ARG002
        from_s, from_m = self._t, self._s
        self._t, (self._s, v, _) = t_s, self._motion.at(t_s)
        seen = [antenna.look(from_s, from_m, t_s, self._s, v) for antenna in self._antennas]
        last_s = max((pulses.last_s for pulses in seen if pulses is not None), default=None)
        chosen = self._device.choose(seen)
        if last_s is None:
            return self._silence.bound(t_s, self._pitch)
        self._silence.broken(last_s)
        if chosen is None or chosen.before_s is None:
            return None
        dt = chosen.last_s - chosen.before_s
        fields = {
            "speed_mps": chosen.passed * self._pitch / dt,
            "speed_variance_m2ps2": chosen.passed * self._variance / (dt * dt),
            "interval_s": dt,
        }
        return Measured(0.5 * (chosen.last_s + chosen.before_s), fields)
