"""A fault of a unit, as scenario files and commands state it."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from milepost.recordings.options import STRICT
from milepost_schemas.message import Name

from .table import FAULTS


class FaultEntry(BaseModel):
    """A fault `kind` of a unit's readings from `from_s` of scenario time, for `for_s` or to the end, and the kind's options.

    Raises ValidationError for an unknown kind, and for an option that the kind does not have.
    """

    model_config = ConfigDict(**{**STRICT, "extra": "allow"})
    unit: Name
    kind: str
    from_s: float
    for_s: Annotated[float, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _known(self) -> FaultEntry:
        if self.kind not in FAULTS:
            raise ValueError(f"kind: must be one of {', '.join(FAULTS)}, not {self.kind!r}")
        try:
            self.options()
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name, text = ".".join(map(str, first["loc"])), first["msg"].lower()
            if first["type"] == "extra_forbidden":
                known = FAULTS[self.kind].options.model_fields
                text = f"not an option of {self.kind}" + (f", which has {', '.join(known)}" if known else ", which has none")
            raise ValueError(f"{name}: {text}") from error
        return self

    @property
    def to_s(self) -> float:
        """The scenario time at which the fault ends."""
        return math.inf if self.for_s is None else self.from_s + self.for_s

    def options(self) -> Any:
        """The kind's options."""
        return FAULTS[self.kind].options.model_validate(self.model_extra or {})

    def misfit(self, stream: str, sensor: str, has_motion: bool) -> str | None:
        """The reason for which a unit with this stream of readings and kind of sensor cannot have the fault; None: it can."""
        row = FAULTS[self.kind]
        if stream not in row.streams:
            return f"{self.kind} does not fit a {stream}, but {' or '.join(row.streams)}"
        if row.sensors and sensor not in row.sensors:
            return f"{self.kind} does not fit a {sensor}, but {' or '.join(row.sensors)}"
        if row.needs_motion and not has_motion:
            return f"{self.kind} needs a train with a `world`"
        return None
