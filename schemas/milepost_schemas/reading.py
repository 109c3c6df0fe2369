"""What sensors say: one message for each kind of quantity, not for each make of device."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .message import Message, Name, NonNegative, SpeedMps, Variance


class SpeedReading(Message):
    """Along-track speed from a Doppler radar, a loop or a wheel.

    Either a value with its variance, or, where a pulse sensor saw no pulse, an upper bound: silence is never zero.
    """

    SCHEMA: ClassVar[str] = "speed_reading"

    speed_mps: SpeedMps | None = None
    speed_variance_m2ps2: Variance | None = None
    speed_max_mps: Annotated[float, Field(ge=1e-3, le=1e4)] | None = None
    interval_s: NonNegative = 0.0

    @model_validator(mode="after")
    def _value_or_bound(self) -> SpeedReading:
        if (self.speed_mps is None) == (self.speed_max_mps is None):
            raise ValueError("give either speed_mps or speed_max_mps")
        if (self.speed_mps is None) != (self.speed_variance_m2ps2 is None):
            raise ValueError("speed_mps and speed_variance_m2ps2 go together")
        return self


Solution = Literal["none", "propagated", "single", "differential", "rtk_float", "rtk_fixed"]


class PositionReading(Message):
    """A GNSS position and what the receiver says of it; the receiver's word is not to be trusted alone."""

    SCHEMA: ClassVar[str] = "position_reading"

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    solution: Solution


class BaliseTelegram(Message):
    """A balise passed under the reader at `measured_at_ns`; where it lies is the line's knowledge, not the reader's."""

    SCHEMA: ClassVar[str] = "balise_telegram"

    balise_id: Name
    reader_variance_m2: Variance
