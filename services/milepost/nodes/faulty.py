"""A node whose messages are delayed or lost on a faulty link."""

from __future__ import annotations

from collections.abc import Iterable

from milepost.simulation.faults import Fault, Link
from milepost_schemas import Message

from .base import Node, Output


class FaultyNode(Node):
    """The node `inner` behind a link with `fault`; scenario time 0 is at `start_ns`."""

    def __init__(self, inner: Node, fault: Fault, start_ns: int) -> None:
        super().__init__(inner.train, inner.unit, inner.instance)
        self.inner = inner
        self.subscriptions = inner.subscriptions
        self._link = Link(fault, start_ns)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """The inner node's messages that the link delivers now."""
        return self._pass(self.inner.step(message, now_ns), now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """The delayed messages that are due, then those of the inner node's tick if that is due."""
        due_ns = self.inner.next_tick_ns()
        sent = self.inner.tick(now_ns) if due_ns is not None and due_ns <= now_ns else ()
        late = self._link.due(now_ns)
        return [*late, *self._pass(sent, now_ns)]

    def next_tick_ns(self) -> int | None:
        """The earlier of the next delayed message and the inner node's next tick."""
        return min((at for at in (self._link.next_ns(), self.inner.next_tick_ns()) if at is not None), default=None)

    def _pass(self, outputs: Iterable[Output], now_ns: int) -> list[Output]:
        return [passed for output in outputs for passed in self._link.send(output, output.message, now_ns)]
