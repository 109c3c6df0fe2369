"""Doppler radar with one beam: speed over ground."""

from __future__ import annotations

from milepost.recordings.measured import Measured, Source

from ..base import World
from ..periodic import PeriodicSource
from .beam import Beam, Radar, RadarOptions, RadarSensor


class DopplerRadarOptions(RadarOptions):
    """One beam, forward: its mounting pitch is part of its scale, δ tan θ (1.7 % for 1° at 45°)."""


class DopplerRadar(RadarSensor[DopplerRadarOptions]):
    """z = v (cos δ + tan θ sin δ)/(1 + κ) + e, e ~ N(0, R) white. Source: A (10), D (3); see `beam`.

    The scale that a filter learns is (1 + κ)/(1 + δ tan θ) - 1.
    """

    kind = "doppler_radar"
    options_model = DopplerRadarOptions

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated readings of the world's motion."""
        world = self.needed(world)
        return _Simulated(self.unit, self.options, world, from_s)


class _Simulated(PeriodicSource):
    def __init__(self, unit: str, options: DopplerRadarOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s)
        self._radar = Radar(unit, options, world)
        self._beam = Beam(unit, options, world, forward=True)
        self._mounting = options.really.mounting_pitch_rad
        self._leak = options.leak_variance

    def sample(self, index: int, t_s: float) -> Measured | None:
        seen = self._radar.at(index, t_s)
        if seen is None or not self._beam.hears(t_s):
            return None
        v, w, pitch, scale = seen
        shown, R = self._beam.show(index, v, w, self._mounting + pitch, scale)
        return Measured(t_s, self._radar.fields(shown, R + v * v * self._leak[0] + self._leak[1]))
