"""A fault of a fuser's memory, on command: one bit of its belief is flipped, and it computes on with it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from milepost.estimation.beliefs import joined
from milepost.fusion.bank_state import Bank
from milepost.fusion.information_rule import InformationFusion
from milepost.nodes.around import Around
from milepost.nodes.base import Output, Severity, Subscription
from milepost.nodes.fuser import FuserNode
from milepost.simulation.faults import reason_of
from milepost_schemas import FaultCommand, Message

from .table import BIT_FLIP, BitFlip, options_of

# what was true before is in the belief by now: later readings are taken on top of the flipped one
BEFORE_NS = 500_000_000


class CorruptibleFuser(Around):
    """The fuser `inner`, of whose belief commands flip bits: in the row of its bank that it publishes, half a second ago."""

    inner: FuserNode

    def __init__(self, inner: FuserNode) -> None:
        super().__init__(inner, Subscription("chaos", inner.unit))
        # one instance has one numbering
        self._sequences = inner._sequences

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Flip a bit on command, and say so in an event."""
        return self._obeyed(message, now_ns) if isinstance(message, FaultCommand) else self.inner.step(message, now_ns)

    def _obeyed(self, command: FaultCommand, now_ns: int) -> Iterator[Output]:
        severity: Severity = "warning"
        code = "fault_injected"
        try:
            if command.kind is None:
                raise ValueError("a flipped bit is not flipped back: it fades as readings come")
            options = options_of(command)
            assert isinstance(options, BitFlip)
            text = f"fault injected: {self._flipped(options, now_ns)}"
        except ValueError as error:
            code, text = "fault_refused", reason_of(error)
        yield self.event(severity, code, f"{self.unit}: {text} ({command.instance})", now_ns)

    def _flipped(self, options: BitFlip, now_ns: int) -> str:
        """Flip the bit; returns what was flipped, in words. Raises ValueError."""
        rule, at_ns = self.inner.rule, now_ns - BEFORE_NS
        if not isinstance(rule, InformationFusion):
            raise ValueError(f"{BIT_FLIP} needs the fusion rule information")
        if options.state not in rule.names:
            raise ValueError(f"state: must be one of {', '.join(rule.names)}, not {options.state!r}")
        bank: Bank | None = rule.estimator.raw_at(at_ns)
        if bank is None:
            raise ValueError("there is no belief yet")
        place, row = rule.names.index(options.state), bank.leader
        x, P = bank.x.copy(), bank.P.copy()
        cell = P[row, place, place : place + 1] if options.covariance else x[row, place : place + 1]
        before = float(cell[0])
        cell.view(np.uint64)[0] ^= np.uint64(1 << options.bit)
        rule.estimator.timeline.rebase(at_ns, bank.moved(joined(x, P)))
        what = "variance of " if options.covariance else ""
        return f"bit {options.bit} of the {what}{options.state} flipped: {before:g} is {float(cell[0]):g}"
