"""THE TABLE OF A FUSER'S FAULTS: they act on the process, not on a message. A row is a fault; a command asks for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from milepost.simulation.faults import FaultKind, Sent
from milepost.simulation.faults.sending import Step
from milepost_schemas import FaultCommand

BIT_FLIP, WRONG_CLOCK = "bit_flip", "wrong_clock"


class BitFlip(BaseModel):
    """The options of the fault `bit_flip`."""

    model_config = ConfigDict(extra="forbid", strict=True)
    bit: int = Field(51, ge=0, le=63, description="which bit of the float64: 0 to 51 mantissa, 52 to 62 exponent, 63 sign")
    state: str = Field("position_m", description="which state of the belief")
    covariance: bool = Field(False, description="flip the state's variance instead of its mean")


def _sends(*_: object) -> list[Sent]:
    return []


FUSER_FAULTS = {
    row.name: row
    for row in (
        FaultKind(BIT_FLIP, "flips a bit of a fuser's belief, once", BitFlip, _sends, ("fuser",)),
        FaultKind(WRONG_CLOCK, "has a clock that is off", Step, _sends, ("fuser",)),
    )
}


def options_of(command: FaultCommand) -> BaseModel:
    """The options of the fault that a command asks for. Raises ValueError."""
    numbers = {name: int(value) if value.is_integer() else value for name, value in command.numbers.items()}
    return options_from(command.kind or "", {**numbers, **command.words, **command.flags}, command.for_s)


def options_from(kind: str, options: Mapping[str, Any], for_s: float | None) -> BaseModel:
    """The options of a fuser's fault, checked. Raises ValueError."""
    row = FUSER_FAULTS.get(kind)
    if row is None:
        raise ValueError(f"{kind} is a fault of sensors; a fuser has {' and '.join(FUSER_FAULTS)}")
    if kind == BIT_FLIP and for_s is not None:
        raise ValueError(f"{BIT_FLIP} happens once and has no duration")
    return row.options.model_validate(options)
