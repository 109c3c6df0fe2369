"""How a train file says which column of a recording is which field, in which unit."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field, model_validator

from .options import STRICT, DataPath
from .table import utc_seconds
from .units import UNITS

ISO = "iso8601"
Scalar = bool | int | float | str


class TimeOptions(BaseModel):
    """The column of times. `zero_at`: the column's value at scenario time 0, as it would stand there; else the first row's."""

    model_config = STRICT
    column: str
    unit: str = "s"
    zero_at: str | float | None = None

    @model_validator(mode="after")
    def _readable(self) -> TimeOptions:
        if self.unit != ISO and (self.unit not in UNITS or UNITS[self.unit].quantity != "time"):
            raise ValueError(f"{self.unit!r} is no unit of time")
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
    """A column: its unit, or for words what each means (`"ABC*"`: whatever begins so; `"*"`: all others).

    `scale` multiplies what was read: -1 turns an axis round.
    """

    model_config = STRICT
    column: str
    unit: str | None = None
    scale: float = 1.0
    values: dict[str, Scalar] | None = None


class RecordingOptions(BaseModel):
    """A recording: a CSV `file` with a header, its `time`, the columns of the message's fields, and fields that do not change.

    `average_s`: means over so long, for logs faster than a filter needs. `shift_s`: how much later it is replayed.
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
            raise ValueError(f"{name} is a column and a constant")
        return self
