"""Factors between nanoseconds, the unit of stamps, and seconds, the unit of equations."""

from __future__ import annotations

NS_PER_S = 1_000_000_000
S_PER_NS = 1e-9
