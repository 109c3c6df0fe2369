"""GNSS receiver: latitude and longitude, projected on the line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import BeforeValidator, Field

from milepost.simulation.recording import SOLUTIONS
from milepost_schemas import PositionReading

from .base import Belief, Observed, Sensor, SensorOptions, Source, World
from .column_options import RecordingOptions
from .receiver import ReceiverOptions, open_receiver

Std = Annotated[float, Field(gt=0.0)]


WORDS = {f"{word}*": means for word, means in SOLUTIONS.items()} | {"*": "none"}


def _of_path(value: object) -> object:
    """A bare path is a log with the columns of `simulation.recording`."""
    if not isinstance(value, str):
        return value
    return {
        "file": value,
        "time": {"column": "time_utc", "unit": "iso8601"},
        "columns": {
            "latitude_deg": {"column": "latitude_deg", "unit": "deg"},
            "longitude_deg": {"column": "longitude_deg", "unit": "deg"},
            "solution": {"column": "position_type", "values": WORDS},
        },
    }


class GnssOptions(SensorOptions):
    """`position_std_m`: along-track standard deviation by solution; a solution that is not listed does not count.

    `cross_track_limit_m`: a fix farther from the track than this cannot be this train and does not count.
    """

    recording: Annotated[RecordingOptions | None, BeforeValidator(_of_path)] = None
    receiver: ReceiverOptions | None = None
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
        """The fixes of a receiver."""
        if self.options.source != "receiver" or self.options.receiver is None:
            raise ValueError(f"{self.unit}: a {self.kind} needs a `recording` or a `receiver`")
        return open_receiver(self.options.receiver, from_s)
