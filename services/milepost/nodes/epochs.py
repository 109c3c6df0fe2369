"""The times that a fuser goes by: which epoch is next, live and settled, and where its observations begin and end."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

# live epochs older than this are skipped
BACKLOG_NS = 1_000_000_000
# how long the first epoch waits for units without any reading
HOLD_NS = 1_000_000_000
# a fuser whose first observation comes so long after the beginning was started again; a reading may be 0.5 s ahead
LATE_NS = 600_000_000


class Times(NamedTuple):
    """The times of a fuser, None where they are not known yet.

    `earliest_ns`, `latest_ns`: of its observations. `heard_ns`: when it heard the first one. `epoch_ns`, `settled_ns`: the next
    live and the next settled epoch. `resumed_ns`: the state that it continued from after a restart.
    """

    earliest_ns: int | None = None
    latest_ns: int = 0
    heard_ns: int | None = None
    epoch_ns: int | None = None
    settled_ns: int | None = None
    resumed_ns: int = 0


class Epochs:
    """Epochs lie on the grid t_k = k · period. `times` is all that is remembered. `began_ns`: when the train did, if known."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.times = Times()
        self.began_ns: int | None = None

    @property
    def next_ns(self) -> int | None:
        """The next live epoch; None before the first observation."""
        return self.times.epoch_ns

    def grid(self, at_ns: int) -> int:
        """The first epoch at a time or after it."""
        return -(-at_ns // self.period_ns) * self.period_ns

    def continue_from(self, at_ns: int) -> None:
        """Continue after the epoch of a former fuser's state."""
        self.times = self.times._replace(earliest_ns=at_ns, latest_ns=at_ns, resumed_ns=at_ns, epoch_ns=at_ns + self.period_ns)

    def observed(self, at_ns: int, all_heard: Callable[[], bool], now_ns: int) -> None:
        """Note an observation. The first epoch comes once every unit was heard, or a second after the first one.

        The prior sits at the earliest observation: a state that is sent before this observation has come would be wrong.
        """
        earliest_ns, latest_ns, heard_ns, epoch_ns = self.times[:4]
        earliest_ns = at_ns if earliest_ns is None else min(earliest_ns, at_ns)
        if epoch_ns is None:
            heard_ns = heard_ns or now_ns
            if all_heard() or now_ns - heard_ns >= HOLD_NS:
                epoch_ns = self.grid(max(earliest_ns, now_ns - self.period_ns))
        self.times = Times(earliest_ns, max(latest_ns, at_ns), heard_ns, epoch_ns, *self.times[4:])

    def late_since(self, at_ns: int) -> int | None:
        """When the train began, where an observation is the first one and comes long after that."""
        first, began_ns = self.times.earliest_ns is None, self.began_ns
        return began_ns if first and began_ns is not None and at_ns - began_ns > LATE_NS else None

    def skipped(self, now_ns: int) -> int:
        """Skip the live epochs that are too old; returns how many."""
        epoch_ns = self.times.epoch_ns
        if epoch_ns is None or now_ns - epoch_ns <= BACKLOG_NS:
            return 0
        self.times = self.times._replace(epoch_ns=self.grid(now_ns))
        return (now_ns - epoch_ns) // self.period_ns

    def sent(self, epoch_ns: int) -> None:
        """Note that a live epoch was sent."""
        self.times = self.times._replace(epoch_ns=epoch_ns + self.period_ns)

    def next_settled(self, horizon_ns: int, now_ns: int | None) -> int | None:
        """The next settled epoch, once; None where there is none yet. With `now_ns` None, until the last observation."""
        times = self.times
        if times.earliest_ns is None:
            return None
        settled_ns = times.settled_ns
        if settled_ns is None:
            if now_ns is not None and times.earliest_ns >= now_ns - horizon_ns:
                return None
            settled_ns = self.grid(times.earliest_ns)
            self.times = times._replace(settled_ns=settled_ns)
        if settled_ns > times.latest_ns if now_ns is None else settled_ns >= now_ns - horizon_ns:
            return None
        self.times = self.times._replace(settled_ns=settled_ns + self.period_ns)
        return settled_ns
