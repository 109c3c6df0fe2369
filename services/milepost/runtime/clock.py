"""What time it is: UTC, or on a simulated train the scenario's time, which may run faster."""

from __future__ import annotations

import time

from milepost_schemas import SimulationStart


class Clock:
    """UTC in nanoseconds, never going back; under a simulation t_0 + (UTC - t_0) · speed."""

    def __init__(self, simulation: SimulationStart | None = None) -> None:
        self._start_ns = simulation.start_ns if simulation else 0
        self._speed = simulation.speed if simulation else 1.0
        self._last = 0

    def now_ns(self) -> int:
        """The time now."""
        return self.at(time.time_ns())

    def at(self, utc_ns: int) -> int:
        """The time at a wall-clock time."""
        now = utc_ns if self._speed == 1.0 else self._start_ns + round((utc_ns - self._start_ns) * self._speed)
        self._last = max(self._last, now)
        return self._last

    def wait_s(self, until_ns: int) -> float:
        """How long to sleep, in seconds of wall clock, until a time; 0 if it is past."""
        return max(0.0, (until_ns - self.now_ns()) * 1e-9 / self._speed)

    def utc_ns(self, at_ns: int) -> int:
        """The wall-clock time at a time."""
        return at_ns if self._speed == 1.0 else self._start_ns + round((at_ns - self._start_ns) / self._speed)
