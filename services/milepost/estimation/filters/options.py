"""Checks of options that several kinds of filter have."""

from __future__ import annotations

import math
from typing import Any


def positive(options: Any, *names: str) -> None:
    """Raises ValueError for a field that is not above 0 and finite."""
    for name in names:
        if not 0.0 < getattr(options, name) < math.inf:
            raise ValueError(f"{name}: must be above 0 and finite")


def at_most(options: Any, **limits: float) -> None:
    """Raises ValueError for a field above its limit, which bounds the cost of a step."""
    for name, limit in limits.items():
        if getattr(options, name) > limit:
            raise ValueError(f"{name}: must be at most {limit:g}")


def fraction(options: Any, *names: str) -> None:
    """Raises ValueError for a field outside (0, 1)."""
    for name in names:
        if not 0.0 < getattr(options, name) < 1.0:
            raise ValueError(f"{name}: must lie between 0 and 1")
