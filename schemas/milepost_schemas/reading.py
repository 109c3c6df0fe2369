"""The readings of sensors: one message for each kind of quantity, not for each make of device."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .message import Count, Message, Name, NonNegative, SpeedMps, Variance


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


Std = Annotated[float, Field(ge=1e-6, le=1e7)]


class PositionReading(Message):
    """A GNSS position with the receiver's statements on its quality, which are not sufficient alone.

    `horizontal_std_m`: of one horizontal axis, as the receiver states it. `speed_mps` over ground, along `course_deg`
    (clockwise from north).
    """

    SCHEMA: ClassVar[str] = "position_reading"

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    solution: Solution
    altitude_m: Annotated[float, Field(ge=-1e4, le=1e5)] | None = None
    horizontal_std_m: Std | None = None
    satellites: Count | None = None
    hdop: NonNegative | None = None
    speed_mps: SpeedMps | None = None
    speed_std_mps: Std | None = None
    course_deg: Annotated[float, Field(ge=0.0, le=360.0)] | None = None


SpecificForce = Annotated[float, Field(ge=-1e3, le=1e3)]
TurnRate = Annotated[float, Field(ge=-100.0, le=100.0)]


class InertialReading(Message):
    """Means over the last `mean_over_s` of specific force and turn rate, on axes forward, right, down; true at mid-interval.

    At rest on the level the specific force is [0, 0, -g].
    """

    SCHEMA: ClassVar[str] = "inertial_reading"

    specific_force_mps2: Annotated[list[SpecificForce], Field(min_length=3, max_length=3)]
    turn_rate_radps: Annotated[list[TurnRate], Field(min_length=3, max_length=3)]
    mean_over_s: Annotated[float, Field(ge=1e-6, le=10.0)]


class BaliseTelegram(Message):
    """A balise was read at `measured_at_ns`; its position is in the line file, not in the telegram."""

    SCHEMA: ClassVar[str] = "balise_telegram"

    balise_id: Name
    reader_variance_m2: Variance
