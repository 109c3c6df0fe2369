"""Nanoseconds, in which stamps are counted, and seconds, in which equations are written."""

from __future__ import annotations

NS_PER_S = 1_000_000_000
S_PER_NS = 1e-9
