"""Odometer: pulses of a wheel, with the scale of its diameter as a private state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, Field

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import PrivateState
from milepost.recordings.measured import Source
from milepost.recordings.options import STRICT

from ..base import Observer, Pause, Sensor, World
from ..observed import Belief, Observed, Stacked
from ..pulses import PulseOptions
from ..scale import SCALE, scaled_speed, scaled_speeds
from .calibration import Calibration, as_knowledge, from_bytes, to_bytes
from .device import COUNT_VARIANCE, CountedPulses, TimedPulses, Wheel
from .slip import SlipOptions, WheelWatch

Metres = Annotated[float, Field(gt=0.0, le=10.0)]
LARGEST_SCALE_STD = 0.3


class SimulatedWheel(BaseModel):
    """The simulated wheel; without `diameter_m`, the true scale is drawn from the prior."""

    model_config = STRICT

    diameter_m: Metres | None = None
    wear_mps: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0


class OdometerOptions(PulseOptions):
    """`diameter_m`: the nominal diameter; `scale_std`: the relative standard deviation of the true one from it.

    `timer_s`: the resolution with which the device times pulse edges; null: it only counts them in each nominal period.
    `jitter_s`: the bound of the uniform error of the times at which it samples; source D: 0.003 on 0.1 s.
    `speed_noise_std_mps`: everything else that is white (creep of a gripping wheel, vibration). `scale_noise_psd` (1/s):
    how fast the scale may wander; 1e-12 is 6e-5 in an hour.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 10.0
    phase_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    jitter_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    pulses_per_turn: Annotated[int, Field(ge=1, le=100000)] = 100
    diameter_m: Metres = 0.85
    timer_s: Annotated[float, Field(gt=0.0, le=0.1)] | None = 1e-6
    speed_noise_std_mps: Annotated[float, Field(gt=0.0)] = 0.02
    scale_std: Annotated[float, Field(gt=0.0, le=LARGEST_SCALE_STD)] = 0.03
    scale_noise_psd: Annotated[float, Field(ge=0.0)] = 1e-12
    slip: SlipOptions = Field(default_factory=SlipOptions)
    simulated: SimulatedWheel = Field(default_factory=SimulatedWheel)

    @property
    def pitch_m(self) -> float:
        """The nominal distance of a pulse, q = π D/N."""
        return math.pi * self.diameter_m / self.pulses_per_turn


class Odometer(Sensor[OdometerOptions]):
    """z = v/(1 + κ) + e: the speed of the wheel at the nominal diameter D, κ = D_true/D - 1; negative going backwards.

    How it is linearised, and what early readings may claim, is in `scale.scaled_speed`. Source: D (1), (2); κ as a state is
    ours.
    """

    kind = "odometer"
    stream = "speed_reading"
    options_model = OdometerOptions
    # a slip is a lie like any other
    fault_probability = 3e-3
    slip_probability = 3e-3

    @property
    def never_repeats(self) -> bool:
        """Where edges are timed; counts repeat."""
        return self.options.timer_s is not None

    @property
    def pause(self) -> Pause | None:
        """Where edges are timed there is between them none but a bound a window."""
        return None if self.options.timer_s is None else self.options.limits.pause(self.options.pitch_m)

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """`scale` κ: true over nominal diameter, less one; wear makes it a random walk."""
        return (PrivateState("scale", 0.0, self.options.scale_std, noise_psd=self.options.scale_noise_psd, scales_motion=True),)

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """One row. A bound |v| < b (1 + κ) of a device that times edges is v = 0 with the variance given in `pulses`."""
        measured = self._measured(reading)
        if measured is not None:
            return (scaled_speed(*measured, belief, self.private_states[0]),)
        bound = reading.speed_max_mps * (1.0 if belief is None else 1.0 + float(belief.mean[SCALE]))
        return (Observed((0.0, 1.0, 0.0, 0.0), 0.0, self.options.limits.bound_variance(bound, reading.interval_s)),)

    def observe_each(self, reading: Any, beliefs: Beliefs) -> list[Stacked]:
        """`observe` at each belief."""
        measured = self._measured(reading)
        if measured is None:
            return super().observe_each(reading, beliefs)
        return [scaled_speeds(*measured, beliefs)]

    def _measured(self, reading: Any) -> tuple[float, float] | None:
        """The speed and its variance; None for a bound.

        A device that only counts has counted zero, which is a count as any other: where it told nothing of the diameter, this
        would follow from the counts of one alone.
        """
        if reading.speed_mps is not None:
            return reading.speed_mps, reading.speed_variance_m2ps2
        if self.options.timer_s is not None:
            return None
        return 0.0, self.options.limits.bound_variance(reading.speed_max_mps, reading.interval_s, COUNT_VARIANCE)

    def snapshot(self, belief: Belief, at_ns: int) -> bytes | None:
        """The scale in the belief, to be stored."""
        std = math.sqrt(max(float(belief.covariance[SCALE, SCALE]), 0.0))
        return to_bytes(Calibration(self.unit, self.options.diameter_m, float(belief.mean[SCALE]), std, at_ns))

    def restore(self, kept: bytes, now_ns: int) -> Observed:
        """The scale from an earlier run as an observation, h = [0, 0, 0, 1]."""
        options = self.options
        value, variance = as_knowledge(from_bytes(kept), self.unit, options.diameter_m, options.scale_std, now_ns)
        return Observed((0.0, 0.0, 0.0, 1.0), value, variance)

    def observer(self) -> Observer:
        """Watches for spin and slide, and reports the diameter."""
        return WheelWatch(self.observe, self.options.slip, self.options.diameter_m)

    def model(self) -> Observer:
        """The wheel as it is when it grips: whether it slips, the fuser's hypotheses tell."""
        return self

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated pulses of a wheel that wears and creeps."""
        world = self.needed(world)
        options = self.options
        diameter_m = options.simulated.diameter_m
        if diameter_m is None:
            diameter_m = options.diameter_m * (1.0 + world.true_value(self.unit, self.private_states[0]))
        wheel = Wheel(self.unit, world, diameter_m, options.simulated.wear_mps, options.pulses_per_turn)
        device = CountedPulses if options.timer_s is None else TimedPulses
        return device(self.unit, wheel, options, world, from_s)
