"""The world's process: it owns scenario time and publishes the true motion on the epoch grid, for comparison only."""

from __future__ import annotations

from collections.abc import Iterable

from milepost.estimation.time_units import NS_PER_S
from milepost.simulation.motion import Motion
from milepost_schemas import Truth

from .base import Node, Output


class WorldNode(Node):
    """Publishes the truth at each epoch from scenario time `from_s` to its end, `end_s`. Without a motion there is no truth."""

    def __init__(
        self, train: str, instance: str, motion: Motion | None, end_s: float, start_ns: int, period_ns: int, from_s: float = 0.0
    ) -> None:
        super().__init__(train, "world", instance)
        self.end_s = end_s
        self._motion = motion
        self._start_ns = start_ns
        self._period_ns = period_ns
        self._next_ns = -(-(start_ns + round(from_s * NS_PER_S)) // period_ns) * period_ns
        # half a period late: no process waits for the truth, and the others need the processor at the epoch itself
        self._delay_ns = period_ns // 2

    def next_tick_ns(self) -> int | None:
        """The time at which the next epoch's truth is sent."""
        return None if self.finished else self._next_ns + self._delay_ns

    def tick(self, now_ns: int) -> Iterable[Output]:
        """The truth of every epoch until now."""
        out: list[Output] = []
        while self._next_ns + self._delay_ns <= now_ns and not self.finished:
            t = (self._next_ns - self._start_ns) * 1e-9
            if t > self.end_s:
                self.finished = True
                break
            if self._motion is not None:
                s, v, a = self._motion.at(t)
                head = self.head("truth", self._next_ns, now_ns)
                out.append(Output("truth", "", Truth(**head, position_m=s, speed_mps=v, acceleration_mps2=a)))
            self._next_ns += self._period_ns
        return out
