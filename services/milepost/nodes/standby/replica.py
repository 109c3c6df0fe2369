"""One of several fusers of a train: each fuses everything, one of them speaks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from milepost.estimation.observation import FUTURE_NS
from milepost.nodes.around import Around
from milepost.nodes.base import Node, Output, Subscription
from milepost_schemas import FusedState, Message

from .own_clock import OwnClock

# a leader of whom nothing was heard for so many epochs has lost the lead
SILENT_EPOCHS = 3
# a replica that was stopped for longer than this has lost its connection: until it has another it hears nobody, whoever speaks
LEASE_NS = 500_000_000
RECONNECTS_NS = 2_000_000_000
# where nobody has spoken for so long, one that may be deaf speaks all the same; a stop counts as a lease at most
NOBODY_NS = 4_000_000_000
# a busy machine takes so long from the first token to the first state that is heard
LISTENS_NS = 500_000_000
# a standby that hears of no leader, and may not lead, keeps no more than this
KEPT_OUTPUTS = 1000
# who cannot trust its clock leaves the others so much longer to speak
MISLED_NS = 200_000_000
# a machine that is busy for a moment delays all that is heard; a clock that is wrong stays so
TOLD_AFTER_NS = 1_000_000_000


class Lead:
    """Which of a train's replicas speaks; `replicas` are the names of all, `unit` is this one's.

    Of two that speak at once the one with fewer units in use gives way, between equals the later in the list. A replica that
    is late by three epochs gives way by itself: another one may speak for it already. So one that comes back stays silent. One
    that was stopped for so long that it has lost its connection is told that nobody else is there, and does not believe it at
    once: only where nobody has spoken for long, as on a machine so busy that all are stopped over and over.
    """

    def __init__(self, unit: str, replicas: Sequence[str], period_ns: int, deadline_ns: int) -> None:
        self.leads = self.misled = False
        self._rank = {name: rank for rank, name in enumerate(replicas)}
        self._own = self._rank[unit]
        self._others: set[str] = set()
        self._left_alone = False
        self._silence_ns = (SILENT_EPOCHS + self._own) * period_ns
        self._late_ns = SILENT_EPOCHS * period_ns + deadline_ns
        self._heard_ns: int | None = None
        # the last state of any replica, later by the time of stops
        self._spoken_ns: int | None = None
        self._awake_ns: int | None = None
        self._deaf_until_ns = 0
        self._connected_again = False

    def alive(self, unit: str, alive: bool) -> None:
        """A process's token appeared or went."""
        if unit not in self._rank or self._rank[unit] == self._own:
            return
        (self._others.add if alive else self._others.discard)(unit)
        self._left_alone = not self._others
        if alive and self._deaf_until_ns:
            self._connected_again = True

    def spoke(self, other: FusedState, units: int, now_ns: int) -> None:
        """Another replica has published a state; this one has so many units in use."""
        self._heard_ns = self._spoken_ns = now_ns
        if self.misled:
            self.leads = False
            return
        if now_ns - other.measured_at_ns > self._late_ns:
            return
        self._deaf_until_ns, self._connected_again = 0, False
        if other.unit in self._rank:
            # who speaks is there, also where its token has not come yet
            self._others.add(other.unit)
            self._left_alone = False
        rank = self._rank.get(other.unit, self._own + 1)
        if self.leads and (-len(other.sensors), rank) < (-units, self._own):
            self.leads = False

    def awake(self, now_ns: int) -> None:
        """This replica works, as it does in every epoch unless it was stopped."""
        stopped_ns, self._awake_ns = now_ns - (self._awake_ns or now_ns), now_ns
        if stopped_ns > LEASE_NS:
            self.leads, self._connected_again = False, False
            self._heard_ns, self._deaf_until_ns = now_ns, now_ns + RECONNECTS_NS
            if self._spoken_ns is not None:
                self._spoken_ns += stopped_ns - LEASE_NS
        elif stopped_ns > self._late_ns:
            self._gives_way(now_ns)

    def timed(self, ahead_ns: int, now_ns: int) -> bool:
        """This replica's clock is ahead of most others' by so much; whether it has become wrong by that, or right again."""
        wrong = abs(ahead_ns) > (self._late_ns // 2 if self.misled else self._late_ns)
        if wrong == self.misled:
            return False
        self.misled = wrong
        if wrong:
            self._gives_way(now_ns)
        return True

    def publishes(self, epoch_ns: int, now_ns: int) -> None:
        """This replica has something to say of an epoch."""
        if self.leads:
            self._spoken_ns = now_ns
        if now_ns - epoch_ns > self._late_ns:
            self._gives_way(now_ns)

    def _gives_way(self, now_ns: int) -> None:
        if self.leads and self._others:
            self.leads, self._heard_ns = False, now_ns

    def takes_over(self, now_ns: int) -> bool:
        """Whether this replica, which has something to say, speaks from now on.

        One that has just begun listens first: it does not know yet who else is there.
        """
        if self._connected_again:
            # whether another one speaks is heard from now on
            self._connected_again, self._deaf_until_ns = False, now_ns + LISTENS_NS
        if self._spoken_ns is None:
            self._spoken_ns = now_ns
        nobody_speaks = now_ns - self._spoken_ns >= NOBODY_NS
        if now_ns < self._deaf_until_ns and not nobody_speaks:
            return False
        if self._heard_ns is None:
            self._heard_ns = now_ns
        silence_ns = self._silence_ns + (MISLED_NS if self.misled else 0)
        self.leads = self.leads or self._left_alone or nobody_speaks or now_ns - self._heard_ns >= silence_ns
        if self.leads:
            self._spoken_ns = now_ns
        return self.leads


class ReplicaNode(Around):
    """The fuser `inner` as one of `replicas`. What a standby has to say is kept until the leader has said it, or is silent."""

    def __init__(self, inner: Node, replicas: Sequence[str], period_ns: int, deadline_ns: int) -> None:
        super().__init__(inner, Subscription("state"))
        self.peers = [name for name in replicas if name != inner.unit]
        self._lead = Lead(inner.unit, replicas, period_ns, deadline_ns)
        self._clock = OwnClock()
        self._misled_ns, self._told = 0, False
        self._held: list[Output] = []
        self._said_ns = 0
        self._units = 0

    def unit_alive(self, unit: str, alive: bool) -> None:
        """Note that a process's liveliness token appeared or was dropped."""
        self._lead.alive(unit, alive)
        super().unit_alive(unit, alive)

    def step(self, message: Message, now_ns: int) -> Iterator[Output]:
        """Take what the fuser takes, and the states of other replicas."""
        self._lead.awake(now_ns)
        if message.unit != self.unit:
            self._clock.heard(message.unit, message.published_at_ns, now_ns)
        yield from self._timed(now_ns)
        if not isinstance(message, FusedState):
            yield from self._passed(self.inner.step(message, now_ns), now_ns)
        elif message.instance != self.instance and (self._lead.misled or message.measured_at_ns <= now_ns + FUTURE_NS):
            self._lead.spoke(message, self._units, now_ns)
            self._said_ns = max(self._said_ns, message.measured_at_ns)
            self._forget()

    def tick(self, now_ns: int) -> Iterator[Output]:
        """Publish what is due, where this replica leads."""
        self._lead.awake(now_ns)
        yield from self._timed(now_ns)
        yield from self._passed(self.inner.tick(now_ns), now_ns)

    def _timed(self, now_ns: int) -> Iterator[Output]:
        """Look whether this replica's clock is right; says so where it stays wrong, and where it is right again."""
        ahead_ns = self._clock.ahead_ns(now_ns)
        if self._lead.timed(ahead_ns, now_ns):
            # what it had to say by another time is not about these epochs
            self._held.clear()
            self._misled_ns = now_ns
        if not self._lead.misled:
            if self._told:
                self._told = False
                yield self.event("info", "clock_right", f"{self.unit}: its clock is right again, and it may lead", now_ns)
        elif not self._told and now_ns - self._misled_ns >= TOLD_AFTER_NS:
            self._told = True
            off = f"{abs(ahead_ns) * 1e-9:.2f} s {'ahead of' if ahead_ns > 0 else 'behind'}"
            text = f"{self.unit}: its clock is {off} most others', or all that it hears comes late: it does not lead"
            yield self.event("error", "clock_wrong", text, now_ns)

    def _passed(self, outputs: Iterable[Output], now_ns: int) -> Iterator[Output]:
        for output in outputs:
            if isinstance(output.message, FusedState):
                self._units = len(output.message.sensors)
                self._lead.publishes(output.message.measured_at_ns, now_ns)
            if self._lead.leads:
                yield self._numbered(output, now_ns)
            else:
                self._held.append(output)
        self._forget()
        if self._held and self._lead.takes_over(now_ns):
            held, self._held = self._held, []
            yield from (self._numbered(output, now_ns) for output in held)
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
