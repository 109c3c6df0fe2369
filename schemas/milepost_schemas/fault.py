"""The command that makes a simulated unit's sensor lie, or stop lying."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from .message import Message, Name


class FaultCommand(Message):
    """To the sensor of `unit`, from the tool `instance`: have a fault of `kind` from now on, or, without one, end all faults.

    `for_s`: None for as long as the process runs. The options of the kind, by type: `numbers`, `words`, `flags`. The sensor
    answers with an event whose text ends with the tool's `instance` in brackets.
    """

    SCHEMA: ClassVar[str] = "fault_command"

    kind: Name | None = None
    for_s: Annotated[float, Field(gt=0.0)] | None = None
    numbers: dict[Name, float] = Field(default_factory=dict)
    words: dict[Name, Name] = Field(default_factory=dict)
    flags: dict[Name, bool] = Field(default_factory=dict)
