"""A fault of a fuser's clock, on command: it is ahead or behind, for a while or until it is cleared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.around import Around
from milepost.nodes.base import Node, Output, Severity
from milepost.simulation.faults import reason_of
from milepost.simulation.faults.sending import Step
from milepost_schemas import FaultCommand, Feedback, Message, SnapshotPart

from .table import WRONG_CLOCK, options_of


class WrongClock(Around):
    """The fuser `inner`, whose clock commands set wrong; what else it is commanded, `inner` obeys.

    A clock never goes back: one that is set back stands still until it is as late as before.
    """

    def __init__(self, inner: Node) -> None:
        super().__init__(inner)
        # one instance has one numbering
        self._sequences = inner._sequences
        self._ahead_ns = self._shown_ns = self._now_ns = 0
        self._until_ns: int | None = None

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Set the clock wrong or right on command, and say so in an event."""
        if isinstance(message, FaultCommand) and (message.kind == WRONG_CLOCK or self._ends(message)):
            return self._obeyed(message, now_ns)
        return self.inner.step(message, self._shown(now_ns))

    def tick(self, now_ns: int) -> Iterable[Output]:
        """What the fuser does by its clock; the end of the fault."""
        if self._until_ns is not None and now_ns >= self._until_ns:
            self._ahead_ns, self._until_ns = 0, None
            return (self.event("info", "fault_cleared", f"{self.unit}: its clock is right again", now_ns),)
        return self.inner.tick(self._shown(now_ns))

    def next_tick_ns(self) -> int | None:
        """The fuser's next epoch by its clock, or the end of the fault."""
        inner_ns = self.inner.next_tick_ns()
        due_ns = None if inner_ns is None else max(inner_ns - self._ahead_ns, self._now_ns)
        return due_ns if self._until_ns is None else self._until_ns if due_ns is None else min(due_ns, self._until_ns)

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """Continue from a running process's feedback."""
        return self.inner.catch_up(feedback, self._shown(now_ns))

    def hand_over(self, now_ns: int) -> Iterator[SnapshotPart]:
        """What the fuser knows."""
        return self.inner.hand_over(self._shown(now_ns))

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:
        """Continue from what another fuser knows."""
        self.inner.take_over(parts, agreed, self._shown(now_ns))

    def _shown(self, now_ns: int) -> int:
        """What its clock shows."""
        self._now_ns = now_ns
        self._shown_ns = max(self._shown_ns, now_ns + self._ahead_ns)
        return self._shown_ns

    def _ends(self, command: FaultCommand) -> bool:
        """Whether a command ends this fault."""
        return command.kind is None and self._ahead_ns != 0

    def _obeyed(self, command: FaultCommand, now_ns: int) -> Iterator[Output]:
        severity: Severity = "warning"
        code = "fault_injected"
        if command.kind is None:
            self._ahead_ns, self._until_ns = 0, None
            code, severity, text = "fault_cleared", "info", "injected faults ended: wrong_clock"
        else:
            try:
                options = options_of(command)
                assert isinstance(options, Step)
                self._ahead_ns = round(options.by_s * NS_PER_S)
                self._until_ns = None if command.for_s is None else now_ns + round(command.for_s * NS_PER_S)
                text = f"fault injected: its clock is {abs(options.by_s):g} s {'ahead' if options.by_s > 0.0 else 'behind'}"
            except ValueError as error:
                code, text = "fault_refused", reason_of(error)
        yield self.event(severity, code, f"{self.unit}: {text} ({command.instance})", now_ns)
