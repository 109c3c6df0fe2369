"""When a recorder begins a new file, and when it stops."""

from __future__ import annotations

from dataclasses import dataclass

MIB = 1 << 20


@dataclass(frozen=True, slots=True)
class Limits:
    """When a new file is begun, and how much room is always left on the disk."""

    rotate_bytes: int = 256 * MIB
    rotate_s: float = 3600.0
    least_free_bytes: int = 1024 * MIB

    @classmethod
    def of(cls, rotate_mib: float, rotate_min: float, least_free_mib: float) -> Limits:
        """The limits in the units of the command line."""
        return cls(round(rotate_mib * MIB), rotate_min * 60.0, round(least_free_mib * MIB))
