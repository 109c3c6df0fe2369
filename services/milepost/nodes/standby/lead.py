"""Which of several fusers of a train speaks."""

from __future__ import annotations

from collections.abc import Sequence

from milepost.nodes.clocks.own_clock import late_after_ns
from milepost_schemas import FusedState

# a leader of whom nothing was heard for so many epochs, and no less than so long, has lost the lead
SILENT_EPOCHS = 3
SHORTEST_SILENCE_NS = 80_000_000
# one that was held up for this part of that time gives way, before another one can have taken over
OWN_PART = 0.7
# a replica that was stopped for longer than this has lost its connection: until it has another it hears nobody, whoever speaks
LEASE_NS = 500_000_000
RECONNECTS_NS = 2_000_000_000
# its last sign of life may be a quarter of a lease old, or more on a busy machine: after a shorter stop it may have lost it too
MAY_LOSE_NS = LEASE_NS // 2
# where nobody has spoken for so long, one that may be deaf speaks all the same; a stop counts as a lease at most
NOBODY_NS = 4_000_000_000
# where others are heard but no replica for so long, and for no fewer epochs than a silent leader, one speaks even if it is held
# up again and again; each later one in the list waits so much longer
QUIET_NS, NEXT_NS = 300_000_000, 150_000_000
# a busy machine takes so long from the first token to the first state that is heard
LISTENS_NS = 500_000_000
# who cannot trust its clock waits so much longer before it speaks, and as much again for each one before it in the list
MISLED_NS = 200_000_000


class Lead:
    """Which of a train's replicas speaks; `replicas` are the names of all, `unit` is this one's.

    Of two that speak at once the one with fewer units in use gives way, between equals the later in the list. A leader that was
    held up gives way by itself, before another one speaks for it. So one that comes back stays silent. A leader counts as
    silent while others are heard: where nothing at all is heard, the network is silent, or this replica is held up. One that
    was stopped may have lost its connection, and listens first: what the leader said meanwhile may come after all the rest. One
    that was stopped for so long that it has lost it is told that nobody else is there, and does not believe it at once: only
    where nobody has spoken for long, as on a machine so busy that all are stopped over and over. One that speaks because nobody
    did keeps the lead, however late it is, until another one is heard.
    """

    def __init__(self, unit: str, replicas: Sequence[str], period_ns: int, deadline_ns: int) -> None:
        self.leads = self.misled = False
        self._rank = {name: rank for rank, name in enumerate(replicas)}
        self._own = self._rank[unit]
        self._others: set[str] = set()
        self._left_alone = self._unopposed = False
        silence_ns = max(SILENT_EPOCHS * period_ns, SHORTEST_SILENCE_NS)
        self._silence_ns = silence_ns + self._own * period_ns
        self._quiet_ns = max(QUIET_NS, silence_ns) + self._own * NEXT_NS
        self._held_up_ns = round(OWN_PART * silence_ns)
        self.late_ns = late_after_ns(period_ns, deadline_ns)
        # when a leader, and when anybody, was last heard
        self._heard_ns: int | None = None
        self._anybody_ns: int | None = None
        # the last state of any replica, later by the time of stops
        self._spoken_ns: int | None = None
        self._awake_ns = 0
        self._deaf_until_ns = 0
        # after a stop it takes nobody for gone or silent until then
        self._listens_until_ns = 0
        self._connected_again = False
        # by how much its time was left behind by a stop
        self._behind_ns = 0

    def alive(self, unit: str, alive: bool) -> None:
        """A process's token appeared or went."""
        if unit not in self._rank or self._rank[unit] == self._own:
            return
        (self._others.add if alive else self._others.discard)(unit)
        self._left_alone = not self._others
        if alive and self._awake_ns < self._listens_until_ns:
            self._listens_until_ns = max(self._listens_until_ns, self._awake_ns + LISTENS_NS)
        if alive and self._deaf_until_ns:
            self._connected_again = True

    def spoke(self, other: FusedState, units: int, now_ns: int) -> None:
        """Another replica has published a state; this one has so many units in use."""
        self._heard_ns, self._spoken_ns, self._unopposed = min(other.published_at_ns, now_ns), now_ns, False
        if self.misled:
            self.leads = False
            return
        if now_ns - other.measured_at_ns > self.late_ns:
            return
        if now_ns < self._deaf_until_ns and self._behind_ns > self.late_ns:
            # it lay in the queue, which this replica's time follows
            return
        self._deaf_until_ns, self._connected_again = 0, False
        if other.unit in self._rank:
            # who speaks is there, also where its token has not come yet
            self._others.add(other.unit)
            self._left_alone = False
        rank = self._rank.get(other.unit, self._own + 1)
        if self.leads and (-len(other.sensors), rank) < (-units, self._own):
            self.leads = False

    def heard(self, published_ns: int) -> None:
        """What others published until then has been heard."""
        self._anybody_ns = published_ns

    def awake(self, now_ns: int, stopped_ns: int = 0) -> None:
        """This replica works, and did not for so long before."""
        if not self._awake_ns and self._own:
            # all processes of a train begin at once: the first in the list is left time to speak
            self._heard_ns = now_ns + LISTENS_NS
        elif now_ns - self._awake_ns > self._held_up_ns:
            # it does not know yet what was said meanwhile
            self._heard_ns = max(self._heard_ns or 0, now_ns)
        leapt_ns, self._awake_ns = now_ns - self._awake_ns - stopped_ns, now_ns
        if self._deaf_until_ns and leapt_ns > 0:
            # the time has caught up with the stop: nothing was heard in what it left out
            self._deaf_until_ns += leapt_ns
            self._behind_ns -= leapt_ns
        if stopped_ns > max(MAY_LOSE_NS, self._held_up_ns) and self._somebody_speaks():
            self._listens_until_ns = now_ns - leapt_ns + LISTENS_NS
        if stopped_ns > LEASE_NS:
            self.leads = self._unopposed = self._connected_again = False
            self._behind_ns = -leapt_ns
            self._heard_ns, self._deaf_until_ns = now_ns, now_ns + RECONNECTS_NS + self._own * NEXT_NS
            if self._spoken_ns is not None:
                self._spoken_ns += stopped_ns - LEASE_NS
        elif stopped_ns > self._held_up_ns:
            self.gives_way(now_ns)
            # the time may not have caught up with the stop yet
            self._heard_ns = now_ns + stopped_ns

    def joins(self, now_ns: int) -> None:
        """This replica has what another one knew, which runs: it listens before it speaks."""
        self._heard_ns = now_ns + LISTENS_NS

    def timed(self, wrong: bool, now_ns: int) -> None:
        """Whether this replica's clock is wrong: then it leads only while nobody else speaks."""
        if wrong != self.misled:
            self.misled, self._heard_ns = wrong, now_ns

    def publishes(self, epoch_ns: int, now_ns: int) -> None:
        """This replica has something to say of an epoch."""
        if self.leads:
            self._spoken_ns = now_ns
        if now_ns - epoch_ns > self.late_ns:
            self.gives_way(now_ns)

    def gives_way(self, now_ns: int) -> None:
        """Another one may speak, where there is one."""
        if self.leads and self._others and not self._unopposed:
            self.leads, self._heard_ns = False, now_ns

    def takes_over(self, now_ns: int, behind_ns: int = 0) -> bool:
        """Whether this replica, which has something to say, speaks from now on; `behind_ns`: what came since is still waiting.

        One that has just begun listens first: it does not know yet who else is there.
        """
        if self._connected_again:
            # whether another one speaks is heard from now on
            self._connected_again, self._deaf_until_ns = False, now_ns + LISTENS_NS
        if self._spoken_ns is None:
            self._spoken_ns = now_ns
        nobody_speaks = now_ns - self._spoken_ns >= NOBODY_NS + self._own * LISTENS_NS
        if now_ns < self._deaf_until_ns and not nobody_speaks:
            return False
        if self._heard_ns is None:
            self._heard_ns = now_ns
        until_ns = now_ns - behind_ns
        if not self.leads and (nobody_speaks or self._quiet(self._spoken_ns, until_ns)):
            self.leads = self._unopposed = True
        elif not self.leads and now_ns >= self._listens_until_ns:
            self.leads = self._left_alone or self._silent(max(self._heard_ns, self._listens_until_ns), until_ns)
        if self.leads:
            self._spoken_ns = now_ns
        return self.leads

    def _somebody_speaks(self) -> bool:
        """Whether a replica has spoken since this one listened last; else it does not listen again, however often it stops."""
        return self._spoken_ns is None or self._spoken_ns >= self._listens_until_ns - LISTENS_NS

    def _silent(self, heard_ns: int, until_ns: int) -> bool:
        """Whether the leader is silent: others were heard so long after it, or nobody is heard any more."""
        silence_ns = self._silence_ns + (MISLED_NS * (1 + self._own) if self.misled else 0)
        if self._anybody_ns is not None and until_ns - self._anybody_ns < LEASE_NS:
            until_ns = min(until_ns, self._anybody_ns)
        return until_ns - heard_ns >= silence_ns

    def _quiet(self, spoken_ns: int, until_ns: int) -> bool:
        """Whether others were heard, but for long no replica: then how often this one was held up does not matter."""
        if self._anybody_ns is None:
            return False
        # two that were stopped together may be awake together for moments only: the first in the list speaks, and is heard
        from_ns = max(spoken_ns, self._listens_until_ns + self._own * LISTENS_NS)
        return min(until_ns, self._anybody_ns) - from_ns >= self._quiet_ns
