"""Nodes behind a fault: of the link that delays or loses their messages, or of the sensor that sends the readings."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from pydantic import ValidationError

from milepost.recordings.options import nearest
from milepost.simulation.faults import Fault, FaultEntry, Injection, Link, reason_of
from milepost.track.line import Line
from milepost_schemas import FaultCommand, Message

from .base import Node, Output, Severity, Subscription


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
        late_ns, own_ns = self._link.next_ns(), self.inner.next_tick_ns()
        return own_ns if late_ns is None else late_ns if own_ns is None else min(late_ns, own_ns)

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
    """A sensor's node whose readings go through `injection`; its events stay as they are.

    `takes_commands`: whether faults begin and end by messages while it runs.
    """

    def __init__(self, inner: Node, injection: Injection, takes_commands: bool = False) -> None:
        super().__init__(inner)
        self._injection = injection
        if takes_commands:
            self.subscriptions = [*inner.subscriptions, Subscription("chaos", inner.unit)]

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Begin or end faults on command, and say so in an event."""
        if not isinstance(message, FaultCommand):
            return super().step(message, now_ns)
        severity, code, text = self._obey(message, now_ns)
        return (self.inner.event(severity, code, f"{self.unit}: {text} ({message.instance})", now_ns),)

    def _obey(self, command: FaultCommand, now_ns: int) -> tuple[Severity, str, str]:
        if command.kind is None:
            ended = ", ".join(fault.kind for fault in self._injection.clear()) or "there was none"
            return "info", "fault_cleared", f"injected faults ended: {ended}"
        try:
            fault = fault_of(command, (now_ns - self._injection.start_ns) * 1e-9)
            unknown = unknown_balise(fault, self._injection.around.line)
            if unknown is not None:
                raise ValueError(unknown)
            self._injection.begin(fault)
        except ValueError as error:
            return "warning", "fault_refused", reason_of(error)
        return "warning", "fault_injected", f"fault injected: {fault.text}"

    def carry(self, output: Output, now_ns: int) -> Iterable[tuple[Output, float]]:
        """What the unit's faults make of a reading; a reading that no message can hold is refused, as any other."""
        if output.stream != self._injection.around.stream:
            return [(output, 0.0)]
        try:
            sent = self._injection.send(output.message)
        except ValidationError as error:
            refused = self.inner.refuse("invalid_reading", f"{self.unit}: {reason_of(error)}", now_ns)
            return [(event, 0.0) for event in refused]
        return [(Output(output.stream, output.unit, message), delay_s) for message, delay_s in sent]


def fault_of(command: FaultCommand, from_s: float) -> FaultEntry:
    """The fault that a command asks for, from `from_s` on. Raises ValidationError."""
    # a whole number may be meant for a count as well as for a quantity
    numbers = {name: int(value) if value.is_integer() else value for name, value in command.numbers.items()}
    head = {"unit": command.unit, "kind": command.kind, "from_s": from_s, "for_s": command.for_s}
    return FaultEntry.model_validate({**numbers, **command.words, **command.flags, **head})


def unknown_balise(fault: FaultEntry, line: Line) -> str | None:
    """What is wrong with a fault of a balise that the line does not have; None: nothing."""
    balise = getattr(fault.options(), "balise", None)
    known = [each.balise_id for each in line.balises]
    if balise is None or balise in known:
        return None
    return f"balise: {balise} is not among the {len(known)} of {line.name}{nearest(balise, known)}"
