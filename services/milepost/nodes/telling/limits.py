"""The limits of positions and speeds in messages."""

from __future__ import annotations

FARTHEST_M = 1e7
FASTEST_MPS = 200.0


def within(value: float, most: float) -> float:
    """The nearest value of [-most, most]."""
    return min(max(value, -most), most)
