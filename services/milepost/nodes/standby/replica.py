"""One of several fusers of a train: each fuses everything, one of them speaks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from milepost.estimation.observation import FUTURE_NS
from milepost.nodes.base import Node, Output, Subscription
from milepost.nodes.clocks.timed import Timed
from milepost_schemas import Feedback, FusedState, Message, SnapshotPart

from .lead import Lead

# a standby that hears of no leader, and may not lead, keeps no more than this
KEPT_OUTPUTS = 1000


class ReplicaNode(Timed):
    """The fuser `inner` as one of `replicas`. What a standby has to say is kept until the leader has said it, or is silent."""

    consequence = "it does not lead"

    def __init__(self, inner: Node, replicas: Sequence[str], period_ns: int, deadline_ns: int) -> None:
        self._lead = Lead(inner.unit, replicas, period_ns, deadline_ns)
        super().__init__(inner, self._lead.late_ns, Subscription("state"))
        # what is forgotten gets no number of this instance's
        self._sequences = {}
        self.peers = [name for name in replicas if name != inner.unit]
        self._turn_ns = 0
        # until when this process is known to have worked, by a steady clock and by its own time
        self._worked_ns: int | None = None
        self._done_ns = 0
        self._held: list[Output] = []
        self._said_ns = 0
        self._units = 0

    def unit_alive(self, unit: str, alive: bool) -> None:
        """Note that a process's liveliness token appeared or was dropped."""
        if self._worked_ns is not None:
            # the stop in which a connection was lost is known before the tokens that went with it
            self._works(self._done_ns)
        self._lead.alive(unit, alive)
        super().unit_alive(unit, alive)

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:
        """Continue from what a peer knows, which may be speaking."""
        super().take_over(parts, agreed, now_ns)
        self._lead.joins(self._time.right_ns(now_ns))

    def step(self, message: Message, now_ns: int) -> Iterator[Output]:
        """Take what the fuser takes, and the states of other replicas."""
        self._hears(message, now_ns)
        at = self._awake(now_ns)
        if message.unit != self.unit:
            self._lead.heard(self._time.others_ns)
        yield from self._timed(at)
        if not isinstance(message, FusedState):
            yield from self._passed(self.inner.step(message, at), at)
        elif message.instance != self.instance and message.measured_at_ns <= at + FUTURE_NS:
            self._lead.spoke(message, self._units, at)
            self._said_ns = max(self._said_ns, message.measured_at_ns)
            self._forget()

    def tick(self, now_ns: int) -> Iterator[Output]:
        """Publish what is due, where this replica leads."""
        at = self._awake(now_ns)
        yield from self._timed(at)
        yield from self._passed(self.inner.tick(at), at)

    def _awake(self, now_ns: int) -> int:
        """The time of the turn that begins."""
        self._turn_ns = now_ns
        at = self._time.at(now_ns)
        self._works(at)
        return at

    def _works(self, at: int) -> int:
        """Note that this process works, in a turn of the time `at`; returns the time now."""
        spent_ns = self.lateness.spent_ns()
        works_ns = self.lateness.steady_ns(self._turn_ns)
        stopped_ns = 0 if self._worked_ns is None else works_ns - self._worked_ns
        self._worked_ns, self._done_ns = works_ns, at + spent_ns
        self._lead.awake(self._done_ns, stopped_ns)
        return self._done_ns

    def _timed(self, at: int) -> Iterator[Output]:
        """Look whether this replica's clock is right; one whose clock stays wrong gives way."""
        self._lead.timed(self._time.wrong, at)
        for news in self._news(at):
            if self._time.wrong:
                self._lead.gives_way(at)
            yield news

    def _passed(self, outputs: Iterable[Output], at: int) -> Iterator[Output]:
        for output in outputs:
            # what has been computed may be late by now: the process may have been stopped meanwhile
            done_ns = self._works(at)
            if isinstance(output.message, FusedState):
                self._units = len(output.message.sensors)
                self._lead.publishes(output.message.measured_at_ns, done_ns)
            if self._lead.leads:
                yield self._numbered(output, at)
            else:
                self._held.append(output)
        self._forget()
        if self._held and self._lead.takes_over(at, self.lateness.waited_ns):
            held, self._held = self._held, []
            yield from (self._numbered(output, at) for output in held)
        del self._held[:-KEPT_OUTPUTS]

    def _forget(self) -> None:
        """Forget what the leader has said: all up to the last epoch that it published."""
        said = (i for i, (stream, _, m) in enumerate(self._held) if stream != "event" and m.measured_at_ns <= self._said_ns)
        del self._held[: max(said, default=-1) + 1]

    def _numbered(self, output: Output, now_ns: int) -> Output:
        """The output with this instance's next number: what was forgotten never had one."""
        stream, unit, message = output
        sequence = self._sequences.get(stream, 0)
        self._sequences[stream] = sequence + 1
        if message.sequence == sequence:
            return output
        return Output(stream, unit, message.model_copy(update={"sequence": sequence, "published_at_ns": now_ns}))
