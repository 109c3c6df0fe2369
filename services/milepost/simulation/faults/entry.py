"""A fault of a unit, as scenario files and commands state it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from milepost.recordings.options import STRICT, nearest
from milepost_schemas.message import Name

from .table import FAULTS


def reason_of(error: ValueError) -> str:
    """The first mistake as `field: what is wrong`."""
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    text = "required" if first["type"] == "missing" else first["msg"].removeprefix("Value error, ")
    return ": ".join([*([".".join(map(str, first["loc"]))] if first["loc"] else []), text])


def not_an_option(kind: str, word: object, written: Callable[[str], str] = str) -> str:
    """`word: not an option of kind, which has ...`, with the nearest option; `written`: how options are written there."""
    known = [written(name) for name in FAULTS[kind].options.model_fields]
    return f"{word}: not an option of {kind}, which has {', '.join(known) or 'none'}{nearest(word, known)}"


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
            # a misspelt option is also a missing one, which pydantic finds first
            strange = next((e["loc"][0] for e in error.errors() if e["type"] == "extra_forbidden"), None)
            raise ValueError(reason_of(error) if strange is None else not_an_option(self.kind, strange)) from error
        return self

    @property
    def text(self) -> str:
        """The fault in a line: kind, options, duration."""
        told = {name: value for name, value in self.options() if value is not None}
        options = ", ".join(
            f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}" for name, value in told.items()
        )
        return " ".join([self.kind, *([f"({options})"] if options else []), *([f"for {self.for_s:g} s"] if self.for_s else [])])

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
            return f"{self.kind} does not fit {stream}, but {' or '.join(row.streams)}"
        if row.sensors and sensor not in row.sensors:
            return f"{self.kind} does not fit {sensor}, but {' or '.join(row.sensors)}"
        if row.needs_motion and not has_motion:
            return f"{self.kind} needs a train with a `world`"
        return None
