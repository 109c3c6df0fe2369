"""One thread that runs many nodes: what came is taken at once, then what is due is done, the earliest first."""

from __future__ import annotations

import heapq
import queue
import time
from collections.abc import Sequence
from typing import Any

from milepost.runtime.bus import Stop
from milepost.runtime.clock import Clock
from milepost.runtime.inbox.taking import take
from milepost.runtime.runner import Runner

# while messages keep coming, what is due waits no longer than this
LONGEST_WAIT_NS = 1_000_000_000


class LabelledInbox(queue.SimpleQueue[Any]):
    """An inbox that says to `ready`, by its label, that something is in it."""

    def __new__(cls, label: int, ready: queue.SimpleQueue[int]) -> LabelledInbox:  # noqa: ARG004
        """Make a queue, which takes no arguments."""
        return super().__new__(cls)

    def __init__(self, label: int, ready: queue.SimpleQueue[int]) -> None:
        self._label = label
        self._ready = ready

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        """Put something in, and say so."""
        super().put(item, block, timeout)
        self._ready.put(self._label)


class Seat:
    """A node's place in the loop: its runner, its inbox, its clock. `due_ns`: when its next turn is due, in UTC."""

    def __init__(self, runner: Runner, inbox: queue.SimpleQueue[Any], clock: Clock) -> None:
        self.runner = runner
        self.inbox = inbox
        self.clock = clock
        self.due_ns = 0

    def look(self) -> None:
        """Note when the next turn is due."""
        self.due_ns = self.clock.utc_ns(self.runner.wake_ns())


class Loop:
    """Runs nodes, each at `seats` by the label of its inbox, until all are over.

    A turn may send messages to other nodes of the same session; they are there when it ends, and are taken before anything
    that is due. So the readings of one train are fused before the next train's are made.
    """

    def __init__(self, seats: Sequence[Seat], ready: queue.SimpleQueue[int]) -> None:
        self._seats = seats
        self._ready = ready
        self._due: list[tuple[int, int]] = []
        for label, seat in enumerate(seats):
            self._look(label, seat)

    def _look(self, label: int, seat: Seat) -> None:
        before = seat.due_ns
        seat.look()
        if seat.due_ns != before:
            heapq.heappush(self._due, (seat.due_ns, label))

    def step(self) -> list[int] | None:
        """Wait for one thing and do it; the labels of those that are over since, None where the process is to stop."""
        label, item = self._next()
        seat = self._seats[label]
        if isinstance(item, Stop):
            return None
        if seat.runner.over:
            return []
        seat.runner.turn(item)
        if seat.runner.orphaned:
            return None
        self._look(label, seat)
        return [label] if seat.runner.over else []

    def _next(self) -> tuple[int, Any]:
        """The next message with the label of its inbox, or the label of a seat whose turn is due, and None."""
        while True:
            due_ns, label = self._due[0]
            if self._seats[label].due_ns != due_ns or self._seats[label].runner.over:
                heapq.heappop(self._due)
                continue
            late_ns = time.time_ns() - due_ns
            if late_ns < LONGEST_WAIT_NS:
                try:
                    came = take(self._ready, -late_ns * 1e-9)
                    return came, self._seats[came].inbox.get_nowait()
                except queue.Empty:
                    if late_ns < 0:
                        continue
            heapq.heappop(self._due)
            # it is looked at again after its turn
            self._seats[label].due_ns = 0
            return label, None
