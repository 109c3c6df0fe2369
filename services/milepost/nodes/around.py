"""A node around another one: what it does not do itself, the inner one does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from milepost_schemas import Feedback, Message, SnapshotPart

from .base import Lateness, Node, Output, Subscription


class Around(Node):
    """A process that is the node `inner` and something more; `more` is what it hears besides."""

    def __init__(self, inner: Node, *more: Subscription) -> None:
        super().__init__(inner.train, inner.unit, inner.instance)
        self.inner = inner
        self.refusals = inner.refusals
        self.peers = inner.peers
        self.remembers, self.watches_processes = inner.remembers, inner.watches_processes
        self.subscriptions = [*inner.subscriptions, *more]

    def keep_time(self, lateness: Lateness) -> None:
        """The node's lateness is this one's."""
        super().keep_time(lateness)
        self.inner.keep_time(lateness)

    @property
    def innermost(self) -> Node:
        """The node itself, without those around it."""
        return self.inner.innermost

    @property
    def rewinds(self) -> int:
        """How often a late observation caused a rewind."""
        return self.inner.rewinds

    def unit_alive(self, unit: str, alive: bool) -> None:
        """Note that a process's liveliness token appeared or was dropped."""
        self.inner.unit_alive(unit, alive)

    def answer(self, procedure: str) -> Message | None:
        """What the node remembers."""
        return self.inner.answer(procedure)

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """Continue from a running process's feedback."""
        return self.inner.catch_up(feedback, now_ns)

    def began(self, start_ns: int) -> None:
        """Note when scenario time began."""
        self.inner.began(start_ns)

    def hand_over(self, now_ns: int) -> Iterator[SnapshotPart]:
        """What the node knows."""
        return self.inner.hand_over(now_ns)

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:
        """Continue from what another fuser knows."""
        self.inner.take_over(parts, agreed, now_ns)

    def next_tick_ns(self) -> int | None:
        """When the node is due."""
        return self.inner.next_tick_ns()

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Take what the node takes."""
        return self.inner.step(message, now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """What the node does."""
        return self.inner.tick(now_ns)
