"""A node that goes by the time of most of what it hears, where its own clock is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from milepost.nodes.around import Around
from milepost.nodes.base import Node, Output, Subscription
from milepost_schemas import FaultCommand, Feedback, Message, SnapshotPart

from .own_clock import Told, TrustedTime


class Timed(Around):
    """The node `inner`, which never sees a clock that is wrong: it is told the time that the others' messages show.

    `late_ns`: a clock that is off by more is wrong. `name`: the process's, where its unit has several. `consequence`: what
    follows from a wrong clock, for people.
    """

    consequence = "it goes by their time"

    def __init__(self, inner: Node, late_ns: int, *more: Subscription, name: str = "") -> None:
        super().__init__(inner, *more)
        self._name = name or inner.unit
        # one instance has one numbering
        self._sequences = inner._sequences
        self._time = TrustedTime(late_ns)
        self._told = Told()

    def next_tick_ns(self) -> int | None:
        """When the node is due, by this process's clock."""
        due_ns = self.inner.next_tick_ns()
        return None if due_ns is None else self._time.clock_ns(due_ns)

    def step(self, message: Message, now_ns: int) -> Iterator[Output]:
        """Take what the node takes."""
        self._hears(message, now_ns)
        at = self._time.at(now_ns)
        yield from self._news(at)
        yield from self.inner.step(message, at)

    def tick(self, now_ns: int) -> Iterator[Output]:
        """What the node does."""
        at = self._time.at(now_ns)
        yield from self._news(at)
        yield from self.inner.tick(at)

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """Continue from a running process's feedback."""
        return self.inner.catch_up(feedback, self._time.right_ns(now_ns))

    def hand_over(self, now_ns: int) -> Iterator[SnapshotPart]:
        """What the node knows."""
        return self.inner.hand_over(self._time.right_ns(now_ns))

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:
        """Continue from what a peer knows."""
        self.inner.take_over(parts, agreed, self._time.right_ns(now_ns))

    def _hears(self, message: Message, now_ns: int) -> None:
        """Note when others say that it is."""
        if message.instance != self.instance and not isinstance(message, FaultCommand):
            self._time.heard(message.unit, message.published_at_ns, now_ns)

    def _news(self, at: int) -> Iterator[Output]:
        """That the clock has been wrong for a second, or is right again."""
        wrong = self._told.news(self._time.wrong, at)
        if wrong is None:
            return
        if not wrong:
            yield self.event("info", "clock_right", f"{self._name}: its clock is right again", at)
            return
        ahead_ns = self._time.ahead_ns
        off = f"{abs(ahead_ns) * 1e-9:.2f} s {'ahead of' if ahead_ns > 0 else 'behind'}"
        text = f"{self._name}: its clock is {off} most others', or all that it hears comes late: {self.consequence}"
        yield self.event("error", "clock_wrong", text, at)
