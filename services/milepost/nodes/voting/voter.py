"""The voter's process: of three fusers' candidates it publishes what two agree on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from milepost.estimation.observation import FUTURE_NS
from milepost.nodes.base import Node, Output, Subscription
from milepost_schemas import Candidate, Feedback, Message

from .agreement import Tolerance, better_heard, difference, outer_interval
from .standing import EPOCHS_OUT, Standings

# candidates of epochs that are older than this are not voted on; a fuser skips such epochs too
OLDEST_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Ballot:
    """An epoch that is voted on: until when, and what was heard by fuser."""

    until_ns: int
    heard: dict[str, Candidate] = field(default_factory=dict)


class VoterNode(Node):
    """One process, and so a single point: while it is away nothing is published.

    An epoch's state and feedback are published as soon as two fusers that have a vote agree: those of the one that has heard
    more units, between equals of the earlier in the list `fusers`, with the outer ends of both intervals, under the voter's own
    head. An epoch is closed when all have spoken, or `deadline_ns` after its time or its first candidate, whichever is later.
    No epoch is published after a later one.
    """

    remembers = True

    def __init__(
        self,
        train: str,
        instance: str,
        fusers: Sequence[str],
        tolerance: Tolerance,
        period_ns: int,
        deadline_ns: int,
        readmit_after_ns: int,
        unit: str = "voter",
    ) -> None:
        super().__init__(train, unit, instance)
        self.subscriptions = [Subscription("candidate")]
        self._tolerance = tolerance
        self._period_ns, self._deadline_ns = period_ns, deadline_ns
        self._readmit_after_ns = readmit_after_ns
        self._standings = Standings(list(fusers), max(1, -(-readmit_after_ns // period_ns)))
        self._ballots: dict[int, Ballot] = {}
        self._published_ns = self._closed_ns = 0
        self._undecided = 0
        self._feedback: Feedback | None = None

    def answer(self, procedure: str) -> Message | None:
        """`latest_feedback`: the last one that was voted."""
        return self._feedback if procedure == "latest_feedback" else None

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        """After a restart, publish no epoch that was published before."""
        if feedback.measured_at_ns > now_ns + FUTURE_NS:
            return False
        self._feedback = feedback
        self._published_ns = self._closed_ns = feedback.measured_at_ns
        return True

    def next_tick_ns(self) -> int | None:
        """The deadline of the oldest epoch that is voted on."""
        return min((ballot.until_ns for ballot in self._ballots.values()), default=None)

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:
        """Take a candidate; publish its epoch if two agree now."""
        if not isinstance(message, Candidate):
            return
        reason = self._unfit(message, now_ns)
        if reason is not None:
            yield from self.refuse(reason, f"{message.unit}: candidate {message.sequence}: {reason}", now_ns)
            return
        at = message.measured_at_ns
        ballot = self._ballots.setdefault(at, Ballot(max(now_ns, at) + self._deadline_ns))
        ballot.heard[message.unit] = message
        if at > self._published_ns:
            yield from self._publish(ballot, now_ns)
        if len(ballot.heard) == len(self._standings.fusers):
            yield from self._close(at, now_ns)

    def tick(self, now_ns: int) -> Iterable[Output]:
        """Close the epochs whose deadline has come."""
        due = [at for at, ballot in self._ballots.items() if ballot.until_ns <= now_ns]
        if due:
            yield from self._close(max(due), now_ns)

    def _unfit(self, candidate: Candidate, now_ns: int) -> str | None:
        """Why a candidate is not voted on; None where it is."""
        at, unit = candidate.measured_at_ns, candidate.unit
        if unit not in self._standings.of:
            return "unknown_unit"
        if at % self._period_ns or candidate.state.epoch != at // self._period_ns:
            return "off_grid"
        if at > now_ns + FUTURE_NS:
            return "from_future"
        if at <= self._closed_ns or at < now_ns - OLDEST_NS:
            return "too_late"
        ballot = self._ballots.get(at)
        return "duplicate" if ballot is not None and unit in ballot.heard else None

    def _publish(self, ballot: Ballot, now_ns: int) -> Iterator[Output]:
        heard = [ballot.heard[fuser] for fuser in self._standings.voting if fuser in ballot.heard]
        pair = next((pair for pair in combinations(heard, 2) if difference(*pair, self._tolerance) is None), None)
        if pair is None:
            return
        agreed, other = better_heard(*pair)
        interval = outer_interval(agreed.state, other.state)
        at = self._published_ns = agreed.measured_at_ns
        if self._undecided:
            text = f"two fusers agree again; {self._undecided} epochs were not published"
            self._undecided = 0
            yield self.event("info", "majority_again", text, now_ns)
        yield Output("state", "", agreed.state.model_copy(update={**self.head("state", at, now_ns), **interval}))
        if agreed.feedback is not None:
            self._feedback = agreed.feedback.model_copy(update={**self.head("feedback", at, now_ns), **interval})
            yield Output("feedback", "", self._feedback)

    def _close(self, until_ns: int, now_ns: int) -> Iterator[Output]:
        """Judge the fusers by all that was heard of the epochs up to this one, whoever spoke first."""
        for at in sorted(at for at in self._ballots if at <= until_ns):
            heard = self._ballots.pop(at).heard
            self._closed_ns = at
            differences = self._differences(heard)
            agrees = {fuser: differences[fuser] is None for fuser in self._standings.fusers}
            decided = sum(agrees[fuser] for fuser in self._standings.voting) >= 2
            lost, regained = self._standings.judge(agrees, heard, decided)
            for fuser in lost:
                yield self._named(fuser, differences[fuser], fuser in heard, now_ns)
            for fuser in regained:
                text = f"{fuser}: has a vote again"
                yield self.event("info", "fuser_readmitted", text, now_ns)
            # at the very beginning the fusers need not begin with the same epoch
            if not decided and self._published_ns:
                yield from self._not_decided(at, heard, differences, now_ns)

    def _differences(self, heard: dict[str, Candidate]) -> dict[str, str | None]:
        """For each fuser None where it agrees with another one that votes; else how it differs from the first that votes."""
        out: dict[str, str | None] = {}
        for fuser in self._standings.fusers:
            own = heard.get(fuser)
            if own is None:
                out[fuser] = "nothing that can be read"
                continue
            others = [heard[other] for other in self._standings.voting if other != fuser and other in heard]
            found = [difference(own, other, self._tolerance) for other in others]
            out[fuser] = None if None in found else found[0] if found else "no other candidate"
        return out

    def _named(self, fuser: str, how: str | None, heard: bool, now_ns: int) -> Output:
        if not heard:
            text = f"{fuser}: no candidate of {EPOCHS_OUT} epochs in a row: no vote until it is heard again and agrees"
            return self.event("warning", "fuser_missing", text, now_ns)
        back = f"no vote until it agrees for {self._readmit_after_ns * 1e-9:g} s"
        text = f"{fuser}: outvoted in {EPOCHS_OUT} epochs in a row ({how}): {back}"
        return self.event("error", "fuser_outvoted", text, now_ns)

    def _not_decided(
        self, at_ns: int, heard: dict[str, Candidate], differences: dict[str, str | None], now_ns: int
    ) -> Iterator[Output]:
        self._undecided += 1
        if self._undecided == 1:
            each = "; ".join(f"{fuser}: {how}" for fuser, how in differences.items() if how is not None)
            text = f"epoch {at_ns // self._period_ns}: no two fusers agree ({len(heard)} heard): not published ({each})"
            yield self.event("error", "no_majority", text, now_ns)
