"""Nodes behind a fault: of the link that delays or loses their messages, or of the sensor that sends the readings."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from pydantic import ValidationError

from milepost.simulation.faults import Fault, Injection, Link
from milepost_schemas import Message

from .base import Node, Output


class Wrapped(Node):
    """The node `inner`, whose messages `carry` loses, alters or delays."""

    def __init__(self, inner: Node) -> None:
        super().__init__(inner.train, inner.unit, inner.instance)
        self.inner = inner
        self.subscriptions = inner.subscriptions
        self.refusals = inner.refusals
        self._link: Link[Output] = Link()

    @abstractmethod
    def carry(self, output: Output, now_ns: int) -> Iterable[tuple[Output, float]]:
        """What is sent in the place of an output, each with its delay in seconds."""

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """The inner node's messages that are sent now."""
        return self._pass(self.inner.step(message, now_ns), now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """The delayed messages that are due, then those of the inner node's tick if that is due."""
        due_ns = self.inner.next_tick_ns()
        sent = self.inner.tick(now_ns) if due_ns is not None and due_ns <= now_ns else ()
        late = self._link.due(now_ns)
        out = [*late, *self._pass(sent, now_ns)]
        self.finished = self.inner.finished and self._link.next_ns() is None
        return out

    def next_tick_ns(self) -> int | None:
        """The earlier of the next delayed message and the inner node's next tick."""
        return min((at for at in (self._link.next_ns(), self.inner.next_tick_ns()) if at is not None), default=None)

    def continue_numbering(self, earlier: Node) -> None:
        """Continue the numbers of the inner node, which sends."""
        self.inner.continue_numbering(earlier.inner if isinstance(earlier, Wrapped) else earlier)

    def _pass(self, outputs: Iterable[Output], now_ns: int) -> list[Output]:
        return [
            passed
            for output in outputs
            for sent, delay_s in self.carry(output, now_ns)
            for passed in self._link.send(sent, delay_s, now_ns)
        ]


class FaultyNode(Wrapped):
    """The node `inner` behind a link with `fault`; scenario time 0 is at `start_ns`."""

    def __init__(self, inner: Node, fault: Fault, start_ns: int) -> None:
        super().__init__(inner)
        self._fault, self._start_ns = fault, start_ns

    def carry(self, output: Output, now_ns: int) -> Iterable[tuple[Output, float]]:
        """The output, unless it is lost."""
        delay_s = self._fault((now_ns - self._start_ns) * 1e-9, output.message)
        return () if delay_s is None else ((output, delay_s),)


class FaultySensor(Wrapped):
    """A sensor's node whose readings go through `injection`; its events stay as they are."""

    def __init__(self, inner: Node, injection: Injection) -> None:
        super().__init__(inner)
        self._injection = injection

    def carry(self, output: Output, now_ns: int) -> Iterable[tuple[Output, float]]:
        """What the unit's faults make of a reading; a reading that no message can hold is refused, as any other."""
        if output.stream != self._injection.around.stream:
            return [(output, 0.0)]
        try:
            sent = self._injection.send(output.message)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            text = f"{self.unit}: {'.'.join(map(str, first['loc']))}: {first['msg']}"
            return [(refused, 0.0) for refused in self.inner.refuse("invalid_reading", text, now_ns)]
        return [(output._replace(message=message), delay_s) for message, delay_s in sent]
