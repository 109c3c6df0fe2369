"""Checks that the options of several kinds share."""

from __future__ import annotations

from typing import Any


def positive(options: Any, *names: str) -> None:
    """Raises ValueError for a field that is not above 0."""
    for name in names:
        if not getattr(options, name) > 0.0:
            raise ValueError(f"{name}: must be above 0")


def fraction(options: Any, *names: str) -> None:
    """Raises ValueError for a field outside (0, 1)."""
    for name in names:
        if not 0.0 < getattr(options, name) < 1.0:
            raise ValueError(f"{name}: must lie between 0 and 1")
