"""Janus radar: two Doppler beams, forward and backward, in which pitch and vertical speed cancel."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from milepost.recordings.measured import Measured, Source

from ..base import World
from ..periodic import PeriodicSource
from .beam import Beam, Radar, RadarOptions, RadarSensor, beam_speed


class JanusRadarOptions(RadarOptions):
    """`scale_std`: what the cancellation leaves, 1 - cos δ = 0.015 % at 1°. Each beam drops out by itself."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 20.0
    scale_std: Annotated[float, Field(ge=0.0, le=0.3)] = 1.5e-4


class JanusRadar(RadarSensor[JanusRadarOptions]):
    """z = (z_f + z_b)/2 = (v cos δ + w sin δ)/(1 + κ) + e, R = (R_f + R_b)/4; one beam where the other hears nothing.

    One beam alone lets pitch δ and vertical speed w in: its reading says R + `leak_variance`. The device knows its mounting
    pitch from z_f - z_b ≈ 2 v δ tan θ and takes it out of a single beam; what leaks is the body's. Source: D 1.2.
    """

    kind = "janus_radar"
    options_model = JanusRadarOptions

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated readings of the world's motion."""
        world = self.needed(world)
        return _Simulated(self.unit, self.options, world, from_s)


class _Simulated(PeriodicSource):
    def __init__(self, unit: str, options: JanusRadarOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s)
        self._radar = Radar(unit, options, world)
        self._mounting = options.really.mounting_pitch_rad
        self._leak = options.leak_variance
        believed = options.mounting_pitch_rad, options.angle_rad
        # each beam with the gain of the mounting that the device believes in, by which one beam alone is divided
        self._beams = [
            (Beam(f"{unit}.{name}", options, world, forward), beam_speed(1.0, 0.0, *believed, forward))
            for name, forward in (("forward", True), ("backward", False))
        ]

    def sample(self, index: int, t_s: float) -> Measured | None:
        seen = self._radar.at(index, t_s)
        if seen is None:
            return None
        v, w, pitch, scale = seen
        heard = [
            (*beam.show(index, v, w, self._mounting + pitch, scale), gain) for beam, gain in self._beams if beam.hears(t_s)
        ]
        if not heard:
            return None
        if len(heard) == 2:
            (one, R_one, _), (other, R_other, _) = heard
            return Measured(t_s, self._radar.fields(0.5 * (one + other), 0.25 * (R_one + R_other)))
        shown, R, gain = heard[0]
        variance = R / (gain * gain) + v * v * self._leak[0] + self._leak[1]
        return Measured(t_s, self._radar.fields(shown / gain, variance))
