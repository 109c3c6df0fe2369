"""The column map of a train file: which column of a recording is which field, in which unit."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field, model_validator

from .options import STRICT, DataPath
from .table import utc_seconds
from .units import UNITS

ISO = "iso8601"
Scalar = bool | int | float | str


class TimeOptions(BaseModel):
    """The time column. `zero_at`: its value at scenario time 0, in its own unit and format; default: that of the first row."""

    model_config = STRICT
    column: str
    unit: str = "s"
    zero_at: str | float | None = None

    @model_validator(mode="after")
    def _readable(self) -> TimeOptions:
        if self.unit != ISO and (self.unit not in UNITS or UNITS[self.unit].quantity != "time"):
            raise ValueError(f"{self.unit!r} is not a unit of time")
        if self.zero_at is not None:
            self.seconds(str(self.zero_at))
        return self

    @property
    def zero_s(self) -> float | None:
        """`zero_at` in seconds."""
        return None if self.zero_at is None else self.seconds(str(self.zero_at))

    def seconds(self, text: str) -> float:
        """A time in the column as seconds. Raises ValueError."""
        return utc_seconds(text) if self.unit == ISO else float(text) * UNITS[self.unit].factor


class ColumnOptions(BaseModel):
    """A column with its unit, or, for words, the value of each word (`"ABC*"`: words that begin so; `"*"`: all others).

    `scale` multiplies the number: -1 reverses an axis.
    """

    model_config = STRICT
    column: str
    unit: str | None = None
    scale: float = 1.0
    values: dict[str, Scalar] | None = None


class RecordingOptions(BaseModel):
    """A recording: a CSV `file` with a header, its `time` column, the columns of the message's fields, and constant fields.

    `average_s`: replay means over this time, for logs faster than a filter needs. `shift_s`: replay this much later.
    """

    model_config = STRICT
    file: DataPath
    time: TimeOptions
    columns: Annotated[dict[str, ColumnOptions | Annotated[list[ColumnOptions], Field(min_length=1)]], Field(min_length=1)]
    constants: dict[str, Any] = Field(default_factory=dict)
    average_s: Annotated[float, Field(gt=0.0, le=60.0)] | None = None
    shift_s: float = 0.0

    @model_validator(mode="after")
    def _once(self) -> RecordingOptions:
        for name in self.constants.keys() & self.columns.keys():
            raise ValueError(f"{name} is both a column and a constant")
        return self
