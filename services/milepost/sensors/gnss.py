"""GNSS receiver: latitude and longitude, projected on the line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from milepost.simulation.recording import RecordedFix, read_gnss_log
from milepost_schemas import PositionReading

from .base import Belief, DataPath, Measured, Observed, Sensor, SensorOptions, Source, World

Std = Annotated[float, Field(gt=0.0)]


class GnssOptions(SensorOptions):
    """`position_std_m`: along-track standard deviation by solution; a solution that is not listed does not count.

    `cross_track_limit_m`: a fix farther from the track than this cannot be this train and does not count.
    """

    recording: DataPath | None = None
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 2.5
    position_std_m: dict[str, Std] = Field(default_factory=lambda: {"rtk_fixed": 0.1})
    cross_track_limit_m: Std = 10.0


class Gnss(Sensor[GnssOptions]):
    """z = chainage of the nearest point of the track, h = [1, 0, 0], R by solution.

    The projection depends on the line and the fix alone, not on the belief, so the observation is exactly linear.
    """

    kind = "gnss"
    stream = "position_reading"
    options_model = GnssOptions

    @property
    def period_s(self) -> float:
        """One fix each 1/rate."""
        return 1.0 / self.options.rate_hz

    def observe(self, reading: PositionReading, belief: Belief | None) -> Sequence[Observed]:  # noqa: ARG002
        """The projected fix, where its solution counts and it lies on the line."""
        std = self.options.position_std_m.get(reading.solution)
        if std is None or self.line.track is None:
            return ()
        seen = self.line.track.project(reading.latitude_deg, reading.longitude_deg)
        if not seen.cross_track_m <= self.options.cross_track_limit_m:
            return ()
        return (Observed((1.0, 0.0, 0.0), seen.position_m, std * std),)

    def open(self, world: World | None, from_s: float) -> Source:  # noqa: ARG002
        """The recorded fixes, at their own pace."""
        if self.options.source != "recording" or self.options.recording is None:
            raise ValueError(f"{self.unit}: a {self.kind} needs `source: recording` and a `recording`")
        return _Replayed(read_gnss_log(self.options.recording), from_s)


class _Replayed:
    def __init__(self, fixes: list[RecordedFix], from_s: float) -> None:
        self._fixes = [fix for fix in fixes if fix.t_s >= from_s]
        self._place = 0

    def next_s(self) -> float | None:
        return self._fixes[self._place].t_s if self._place < len(self._fixes) else None

    def read(self) -> Measured:
        fix = self._fixes[self._place]
        self._place += 1
        fields = {"latitude_deg": fix.latitude_deg, "longitude_deg": fix.longitude_deg, "solution": fix.solution}
        return Measured(fix.t_s, fields)
