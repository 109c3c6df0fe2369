"""Faults of the communication as pure functions of time, and the queue of what is sent late."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Generic, TypeVar

# (scenario time in s, message) -> the message's delay in seconds, None if it is lost
Fault = Callable[[float, Any], float | None]
T = TypeVar("T")


def silent(from_s: float, to_s: float) -> Fault:
    """Messages sent in [from_s, to_s) are lost."""
    return lambda t_s, message: None if from_s <= t_s < to_s else 0.0  # noqa: ARG005


def delayed(seconds: float, from_s: float = 0.0, to_s: float = math.inf) -> Fault:
    """Messages sent in [from_s, to_s) are delayed by `seconds`."""
    return lambda t_s, message: seconds if from_s <= t_s < to_s else 0.0  # noqa: ARG005


class Link(Generic[T]):
    """The queue of delayed items. Times are nanoseconds."""

    def __init__(self) -> None:
        self._held: list[tuple[int, int, T]] = []
        self._count = 0

    def send(self, item: T, delay_s: float, now_ns: int) -> list[T]:
        """Send an item; returns it if it is delivered at once."""
        if delay_s <= 0.0:
            return [item]
        self._held.append((now_ns + round(delay_s * 1e9), self._count, item))
        self._count += 1
        return []

    def due(self, now_ns: int) -> list[T]:
        """The delayed items that are due, in order of their due times."""
        if not self._held:
            return []
        ready = sorted((held for held in self._held if held[0] <= now_ns), key=lambda held: held[:2])
        self._held = [held for held in self._held if held[0] > now_ns]
        return [item for _, _, item in ready]

    def next_ns(self) -> int | None:
        """The due time of the next delayed item; None where there is none."""
        return min(due_ns for due_ns, _, _ in self._held) if self._held else None
