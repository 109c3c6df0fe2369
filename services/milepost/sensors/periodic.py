"""Simulated sources whose readings come on a grid of times."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from milepost.recordings.measured import Measured


class PeriodicSource(ABC):
    """Readings on the grid n · period + phase, from the first grid time ≥ `from_s` to `end_s`."""

    def __init__(self, period_s: float, from_s: float, end_s: float, phase_s: float = 0.0) -> None:
        self.period_s = period_s
        self._phase_s = phase_s
        self._index = max(0, math.ceil((from_s - phase_s) / period_s - 1e-9))
        self._end_s = end_s

    def time_of(self, index: int) -> float:
        """The grid time of a reading."""
        return index * self.period_s + self._phase_s

    def next_s(self) -> float | None:
        """The next grid time; None after the end."""
        t = self.time_of(self._index)
        return t if t <= self._end_s else None

    def read(self) -> Measured | None:
        """The reading at the next grid time."""
        index = self._index
        self._index += 1
        return self.sample(index, self.time_of(index))

    @abstractmethod
    def sample(self, index: int, t_s: float) -> Measured | None:
        """The reading number `index`, taken at `t_s`."""
