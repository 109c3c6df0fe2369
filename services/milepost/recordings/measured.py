"""A reading before it is a message, and where readings come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Measured:
    """A reading that is not a message yet: the scenario time at which it is true, and its fields."""

    measured_s: float
    fields: dict[str, Any]


class Source(Protocol):
    """Where readings come from, on scenario time."""

    def next_s(self) -> float | None:
        """When the next reading is ready; None when there will be no more."""

    def read(self) -> Measured | None:
        """Take that reading; None where the sensor has nothing to say this time."""
