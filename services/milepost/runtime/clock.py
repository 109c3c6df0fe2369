"""What time it is: UTC, or on a simulated train the scenario's time, which may run faster."""

from __future__ import annotations

import time

from milepost.nodes.base import Lateness
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
        self._last = max(self._last, self.then_ns(utc_ns))
        return self._last

    def then_ns(self, utc_ns: int) -> int:
        """The time at a wall-clock time, which may be before one that was told already."""
        return utc_ns if self._speed == 1.0 else self._start_ns + round((utc_ns - self._start_ns) * self._speed)

    def steady_ns(self) -> int:
        """Time that passes as this clock's does, but is never set."""
        return round(time.monotonic_ns() * self._speed)

    def wait_s(self, until_ns: int) -> float:
        """How long to sleep, in seconds of wall clock, until a time; 0 if it is past."""
        return max(0.0, (until_ns - self.now_ns()) * 1e-9 / self._speed)

    def utc_ns(self, at_ns: int) -> int:
        """The wall-clock time at a time."""
        return at_ns if self._speed == 1.0 else self._start_ns + round((at_ns - self._start_ns) / self._speed)


class Turn(Lateness):
    """How late the turn is that a process takes."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._begun_ns = clock.now_ns()

    def begin(self, came_utc_ns: int | None = None) -> int:
        """The time of a turn with what came then, or with nothing."""
        clock, self.waited_ns = self._clock, 0
        if came_utc_ns is None:
            self._begun_ns = clock.now_ns()
        else:
            self._begun_ns = clock.at(came_utc_ns)
            self.waited_ns = clock.now_ns() - clock.then_ns(came_utc_ns)
        return self._begun_ns

    def spent_ns(self) -> int:
        """The time since this turn's."""
        return self._clock.now_ns() - self._begun_ns

    def steady_ns(self, now_ns: int) -> int:  # noqa: ARG002
        """Scenario time since the machine began, whatever the clock shows."""
        return self._clock.steady_ns()
