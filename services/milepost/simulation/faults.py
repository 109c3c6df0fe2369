"""Faults of the communication: pure functions of time, and the link that delays or loses messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

# (scenario time in s, message) -> the message's delay in seconds, None if it is lost
Fault = Callable[[float, Any], float | None]


def silent(from_s: float, to_s: float) -> Fault:
    """Messages sent in [from_s, to_s) are lost."""
    return lambda t_s, message: None if from_s <= t_s < to_s else 0.0  # noqa: ARG005


def delayed(seconds: float, from_s: float = 0.0, to_s: float = math.inf) -> Fault:
    """Messages sent in [from_s, to_s) are delayed by `seconds`."""
    return lambda t_s, message: seconds if from_s <= t_s < to_s else 0.0  # noqa: ARG005


class Link:
    """A link that holds the messages that a fault delays. Times are nanoseconds; scenario time 0 is at `start_ns`."""

    def __init__(self, fault: Fault, start_ns: int) -> None:
        self._fault, self._start_ns = fault, start_ns
        self._held: list[tuple[int, int, Any]] = []
        self._count = 0

    def send(self, item: Any, message: Any, now_ns: int) -> list[Any]:
        """Send an item that carries a message; returns it if it is delivered at once."""
        delay_s = self._fault((now_ns - self._start_ns) * 1e-9, message)
        if delay_s == 0.0:
            return [item]
        if delay_s is not None:
            self._held.append((now_ns + round(delay_s * 1e9), self._count, item))
            self._count += 1
        return []

    def due(self, now_ns: int) -> list[Any]:
        """The delayed items that are due, in order of their due times."""
        ready = sorted(held for held in self._held if held[0] <= now_ns)
        self._held = [held for held in self._held if held[0] > now_ns]
        return [item for _, _, item in ready]

    def next_ns(self) -> int | None:
        """The due time of the next delayed item; None where there is none."""
        return min((due_ns for due_ns, _, _ in self._held), default=None)
