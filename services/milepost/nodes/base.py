"""The interface of a node, as Zenoh, the memory bus and the tests use it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from milepost_schemas import Event, Feedback, Message, Refused, SnapshotPart

Severity = Literal["info", "warning", "error"]


class Output(NamedTuple):
    """A message to be sent: the row of the stream table, the unit in its key, the message."""

    stream: str
    unit: str
    message: Message


@dataclass(frozen=True, slots=True)
class Subscription:
    """A stream that a node receives, of one unit ('*' for any).

    `newest_only`: only the newest message is delivered, together with the next message of another stream.
    """

    stream: str
    unit: str = "*"
    newest_only: bool = False


@dataclass(slots=True)
class Refusals:
    """The number of refused messages by reason; the first of each reason becomes an event."""

    counts: dict[str, int] = field(default_factory=dict)

    def add(self, reason: str) -> bool:
        """Count one refusal; returns whether it is the first for this reason."""
        before = self.counts.get(reason, 0)
        self.counts[reason] = before + 1
        return before == 0


class Lateness:
    """How late a step or tick is: not at all, where nobody says otherwise."""

    # for how long the message that is taken had waited
    waited_ns = 0

    def spent_ns(self) -> int:
        """The time since the `now_ns` of the step or tick."""
        return 0

    def steady_ns(self, now_ns: int) -> int:
        """Time by a clock that nobody sets, in a step or tick of `now_ns`."""
        return now_ns


class Node:
    """A process: step(message) -> messages, without Zenoh or a wall clock: `now_ns` is the time of receipt or of the tick."""

    subscriptions: Sequence[Subscription] = ()
    # whether it answers `latest_feedback`, and asks for it after a restart
    remembers = False
    # the processes that know all that it knows: it answers their `snapshot`, and asks for theirs after a restart
    peers: Sequence[str] = ()
    # whether it follows which processes of the train are there
    watches_processes = False

    def __init__(self, train: str, unit: str, instance: str) -> None:
        self.train = train
        self.unit = unit
        self.instance = instance
        self.refusals = Refusals()
        self.finished = False
        self.lateness = Lateness()
        self._sequences: dict[str, int] = {}

    def keep_time(self, lateness: Lateness) -> None:
        """From now on `lateness` tells how late each step and tick is."""
        self.lateness = lateness

    @property
    def innermost(self) -> Node:
        """The node itself, without those around it."""
        return self

    @property
    def rewinds(self) -> int:
        """How often a late message caused a rewind."""
        return 0

    def step(self, message: Message, now_ns: int) -> Iterable[Output]:  # noqa: ARG002
        """Take one message."""
        return ()

    def tick(self, now_ns: int) -> Iterable[Output]:  # noqa: ARG002
        """Do what is due by `now_ns`."""
        return ()

    def next_tick_ns(self) -> int | None:
        """The time at which `tick` must be called next; None: never."""
        return None

    def unit_alive(self, unit: str, alive: bool) -> None:
        """Note that a process's liveliness token appeared or was dropped."""

    def answer(self, procedure: str) -> Message | None:  # noqa: ARG002
        """The answer to a procedure call; None where there is none yet."""
        return None

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:  # noqa: ARG002
        """After a restart, continue from the feedback that a running process still has. Returns whether it was used."""
        return False

    def began(self, start_ns: int) -> None:
        """Note when scenario time began."""

    def hand_over(self, now_ns: int) -> Iterator[SnapshotPart]:  # noqa: ARG002
        """All that it knows, for a peer that was restarted: each part takes its time when it is asked for."""
        return iter(())

    def take_over(self, parts: Sequence[SnapshotPart], agreed: Feedback, now_ns: int) -> None:  # noqa: ARG002
        """After a restart, continue from a peer's snapshot, if it agrees with what most processes remember.

        Raises Refused where it is not to be used; then nothing has changed.
        """
        raise Refused("snapshot", "nothing is taken over here")

    def continue_numbering(self, earlier: Node) -> None:
        """Continue the sequence numbers of the node that this one replaces: an instance may not use a number twice."""
        self._sequences = dict(earlier._sequences)

    def head(self, stream: str, measured_at_ns: int, now_ns: int) -> dict[str, Any]:
        """The head of this node's next message on a stream."""
        sequence = self._sequences.get(stream, 0)
        self._sequences[stream] = sequence + 1
        return {
            "train": self.train,
            "unit": self.unit,
            "instance": self.instance,
            "sequence": sequence,
            "measured_at_ns": measured_at_ns,
            "published_at_ns": now_ns,
        }

    def event(self, severity: Severity, code: str, text: str, now_ns: int) -> Output:
        """An event of this node."""
        return Output("event", "", Event(**self.head("event", now_ns, now_ns), severity=severity, code=code, text=text))

    def refuse(self, reason: str, text: str, now_ns: int) -> Iterable[Output]:
        """Count a refused message; the first one for a reason is an event."""
        if self.refusals.add(reason):
            yield self.event("warning", f"refused_{reason}", text, now_ns)

    def refuse_reading(self, unit: str, sequence: int, instance: str, reason: str, now_ns: int) -> Iterable[Output]:
        """Count a refused reading; the event names its unit, instance and sequence number."""
        return self.refuse(reason, f"{unit}: reading {sequence} of {instance}: {reason}", now_ns)
