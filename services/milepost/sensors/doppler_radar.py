"""Doppler radar: speed over ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from milepost.simulation.noise import WhiteNoise

from .base import Belief, Measured, Observed, PeriodicSource, Sensor, SensorOptions, Source, World


class DopplerRadarOptions(SensorOptions):
    """`speed_variance_m2ps2`: of one reading; source A gives 0.04."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    speed_variance_m2ps2: Annotated[float, Field(gt=0.0)] = 0.04


class DopplerRadar(Sensor[DopplerRadarOptions]):
    """z = v + e, e ~ N(0, R) white. Source: A (10)."""

    kind = "doppler_radar"
    stream = "speed_reading"
    options_model = DopplerRadarOptions

    @property
    def period_s(self) -> float:
        """One reading each 1/rate."""
        return 1.0 / self.options.rate_hz

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:  # noqa: ARG002
        """h = [0, 1, 0]."""
        if reading.speed_mps is None:
            return ()
        return (Observed((0.0, 1.0, 0.0), reading.speed_mps, reading.speed_variance_m2ps2),)

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated readings of the world's motion."""
        if world is None:
            raise ValueError(f"{self.unit}: a {self.kind} has no source without a simulated world")
        return _Simulated(self.unit, self.options, world, from_s)


class _Simulated(PeriodicSource):
    def __init__(self, unit: str, options: DopplerRadarOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s)
        self._motion = world.motion
        self._noise = WhiteNoise(world.seed, unit)
        self._variance = options.speed_variance_m2ps2
        self._std = options.speed_variance_m2ps2**0.5

    def sample(self, index: int, t_s: float) -> Measured:
        speed = self._motion.at(t_s)[1] + self._std * self._noise[index]
        return Measured(t_s, {"speed_mps": speed, "speed_variance_m2ps2": self._variance})
