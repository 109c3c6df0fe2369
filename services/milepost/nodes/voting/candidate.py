"""A fuser that proposes its states to the voter instead of publishing them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from milepost.nodes.around import Around
from milepost.nodes.base import Node, Output, Subscription
from milepost_schemas import Candidate, Feedback, FusedState, Message

from .agreement import Tolerance, feedback_difference, not_heard, state_difference

# a fuser that contradicts what is voted for so long begins again from the last feedback; the next time after twice as long
PATIENCE_NS, LONGEST_PATIENCE_NS = 1_000_000_000, 60_000_000_000
KEPT = 64


class CandidateNode(Around):
    """The fuser `inner` as one of three: its `state` and `feedback` of an epoch become one candidate; its events stay.

    A belief that was corrupted need not come right by itself: one that contradicts what was voted for a second begins again
    from the voted feedback, as after a restart. None copies another one's bank, as replicas without a voter do: what corrupted
    one of the three would be in two of them.
    """

    hand_over = Node.hand_over
    take_over = Node.take_over

    def __init__(self, inner: Node, tolerance: Tolerance, period_ns: int) -> None:
        super().__init__(inner, Subscription("state", newest_only=True), Subscription("feedback", newest_only=True))
        self._tolerance = tolerance
        self._own: dict[int, Candidate] = {}
        self._proposed_ns = 0
        self._differs: str | None = None
        self._same_heard = True
        self._broken = ""
        # by the epochs in which it was compared
        self._period_ns = period_ns
        self._contradicted_ns = 0
        self._patience_ns = PATIENCE_NS
        # one instance has one numbering
        self._sequences = inner._sequences

    def answer(self, procedure: str) -> Message | None:  # noqa: ARG002
        """Nothing: only what was voted may move another process, and the voter remembers that."""
        return None

    def next_tick_ns(self) -> int | None:
        """The fuser's next epoch; none while no state can be made of its belief."""
        return None if self._broken else self.inner.next_tick_ns()

    def step(self, message: Message, now_ns: int) -> Iterator[Output]:
        """Take what the fuser takes, and what was voted."""
        if isinstance(message, FusedState | Feedback):
            return self._compare(message, now_ns)
        return self._proposed(self.inner.step(message, now_ns), now_ns)

    def tick(self, now_ns: int) -> Iterator[Output]:
        """Propose what is due."""
        return self._proposed(self.inner.tick(now_ns), now_ns)

    def _proposed(self, outputs: Iterable[Output], now_ns: int) -> Iterator[Output]:
        state: FusedState | None = None
        for output in self._computed(outputs):
            message = output.message
            if isinstance(message, Feedback) and state is not None:
                yield from self._candidate(state, message, now_ns)
                state = None
                continue
            if state is not None:
                yield from self._candidate(state, None, now_ns)
                state = None
            if isinstance(message, FusedState):
                state = message
            else:
                yield output
        if state is not None:
            yield from self._candidate(state, None, now_ns)

    def _computed(self, outputs: Iterable[Output]) -> Iterator[Output]:
        """What the fuser says, until no valid message can be made of its belief any more."""
        try:
            yield from outputs
        except (ValueError, ArithmeticError) as error:
            self._broken = str(error).splitlines()[0]

    def _candidate(self, state: FusedState, feedback: Feedback | None, now_ns: int) -> Iterator[Output]:
        at = state.measured_at_ns
        if at <= self._proposed_ns:
            return  # it began again from an epoch of which it has spoken
        self._proposed_ns = at
        # what the fuser has made is the voter's to check
        candidate = Candidate.model_construct(**self.head("candidate", at, now_ns), state=state, feedback=feedback)
        self._own[at] = candidate
        if len(self._own) > KEPT:
            del self._own[min(self._own)]
        yield Output("candidate", self.unit, candidate)

    def _compare(self, voted: FusedState | Feedback, now_ns: int) -> Iterator[Output]:
        if self._broken:
            if isinstance(voted, Feedback) and self.inner.catch_up(voted, now_ns):
                yield self._again(f"its belief cannot be computed with ({self._broken})", now_ns)
            return
        own = self._own.get(voted.measured_at_ns)
        if own is None:
            return
        if isinstance(voted, FusedState):
            self._differs = state_difference(own.state, voted, self._tolerance)
            self._same_heard = not_heard(own.state) == not_heard(voted)
            return
        how = self._differs or feedback_difference(own.feedback, voted, self._tolerance, self._same_heard)
        if how is None:
            # two that have not heard the same are compared so widely that it is no sign of being right
            if self._same_heard:
                self._contradicted_ns, self._patience_ns = 0, PATIENCE_NS
            return
        self._contradicted_ns += self._period_ns
        if self._contradicted_ns >= self._patience_ns and self.inner.catch_up(voted, now_ns):
            yield self._again(f"it contradicts that ({how})", now_ns)

    def _again(self, why: str, now_ns: int) -> Output:
        self._broken, self._contradicted_ns = "", 0
        self._patience_ns = min(2 * self._patience_ns, LONGEST_PATIENCE_NS)
        return self.event("warning", "fuser_began_again", f"{self.unit}: begins again from what was voted: {why}", now_ns)
