"""The common part of all messages: strict fields, physical ranges, valid covariances."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, model_validator

from .covariance import check_covariance

COMMON_STATES = ("position_m", "speed_mps", "acceleration_mps2")

NAME_PATTERN = r"^[a-z0-9][a-z0-9_.-]{0,62}$"
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
TimeNs = Annotated[int, Field(gt=0, lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]

# 10 000 km covers any line; 200 m/s is above the maglev record of 603 km/h; 20 m/s² is a collision, not braking.
PositionM = Annotated[float, Field(ge=-1e7, le=1e7)]
SpeedMps = Annotated[float, Field(ge=-200.0, le=200.0)]
AccelerationMps2 = Annotated[float, Field(ge=-20.0, le=20.0)]
Variance = Annotated[float, Field(ge=1e-12, le=1e15)]
NonNegative = Annotated[float, Field(ge=0.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


Covariance = Annotated[list[list[float]], AfterValidator(check_covariance)]


class Part(BaseModel):
    """A piece of a message: strict, immutable, finite; unknown fields are ignored, so newer senders are understood."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", allow_inf_nan=False)


class Message(Part):
    """The head of every message.

    `sequence` counts from 0 per stream and instance. `measured_at_ns` is the UTC time, in nanoseconds, at which the
    content was true; `published_at_ns` is the time of the step that sent it.
    """

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[int] = 1

    train: Name
    unit: Name
    instance: Name
    sequence: Count
    measured_at_ns: TimeNs
    published_at_ns: TimeNs

    @classmethod
    def encoding(cls) -> str:
        """The encoding that travels with the payload: format, schema name and version."""
        return f"application/msgpack;{cls.SCHEMA}/{cls.VERSION}"


class Gaussian(Part):
    """A mean (n) and its covariance (n x n) over named states, in the order of `states`."""

    states: list[str]
    mean: list[float]
    covariance: Covariance

    @model_validator(mode="after")
    def _sizes_agree(self) -> Gaussian:
        if not len(self.states) == len(self.mean) == len(self.covariance):
            raise ValueError("states, mean and covariance must have the same size")
        if tuple(self.states[:3]) != COMMON_STATES:
            raise ValueError(f"the first states must be {', '.join(COMMON_STATES)}")
        return self
