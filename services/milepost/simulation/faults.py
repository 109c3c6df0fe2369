"""What can happen to messages on their way: pure functions of time, and the link that delays or loses them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

# what happens to a message sent at a scenario time (s): seconds of delay, None for lost
Fault = Callable[[float, Any], float | None]


def silent(from_s: float, to_s: float) -> Fault:
    """Nothing gets through in [from_s, to_s)."""
    return lambda t_s, message: None if from_s <= t_s < to_s else 0.0  # noqa: ARG005


def delayed(seconds: float, from_s: float = 0.0, to_s: float = math.inf) -> Fault:
    """What is sent in [from_s, to_s) comes `seconds` later."""
    return lambda t_s, message: seconds if from_s <= t_s < to_s else 0.0  # noqa: ARG005


class Link:
    """Holds what a fault delays. Times are nanoseconds; scenario time 0 is at `start_ns`."""

    def __init__(self, fault: Fault, start_ns: int) -> None:
        self._fault, self._start_ns = fault, start_ns
        self._held: list[tuple[int, int, Any]] = []
        self._count = 0

    def send(self, item: Any, message: Any, now_ns: int) -> list[Any]:
        """An item that carries a message; returns it if it gets through at once."""
        delay_s = self._fault((now_ns - self._start_ns) * 1e-9, message)
        if delay_s == 0.0:
            return [item]
        if delay_s is not None:
            self._held.append((now_ns + round(delay_s * 1e9), self._count, item))
            self._count += 1
        return []

    def due(self, now_ns: int) -> list[Any]:
        """What was delayed until now, in the order in which it is due."""
        ready = sorted(held for held in self._held if held[0] <= now_ns)
        self._held = [held for held in self._held if held[0] > now_ns]
        return [item for _, _, item in ready]

    def next_ns(self) -> int | None:
        """When the next one is due."""
        return min((due_ns for due_ns, _, _ in self._held), default=None)
