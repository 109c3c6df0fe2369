"""Whether a process's own clock is right, by the stamps of what it hears."""

from __future__ import annotations

from statistics import median_high, median_low

# a message that waited for a busy machine is no sign of a clock that is ahead: the fastest of so long counts
WINDOW_NS = 250_000_000
# one sender may as well be wrong itself
FEWEST = 2
# where nobody is heard for so long, a clock that has leapt is believed
DOUBTED_NS = 500_000_000
# a machine that is busy for a moment delays all that is heard; a clock that is wrong stays so
TOLD_AFTER_NS = 1_000_000_000
# what is so many epochs and the deadline of one behind is late
LATE_EPOCHS = 3


def late_after_ns(period_ns: int, deadline_ns: int) -> int:
    """By how much what is said of an epoch may be behind it; a clock that is off by more is wrong."""
    return LATE_EPOCHS * period_ns + deadline_ns


class OwnClock:
    """By how much this process's clock is ahead of most others'; a link that delays everything looks the same.

    Of each sender the least (time here - time of publishing) over the last one to two windows; of these, the median, and of
    two in the middle the one nearer to 0: more than half must be off. The windows are of the others' time: this clock may
    stand still.
    """

    def __init__(self) -> None:
        # by sender: the window, the least in it, and in the one before
        self._least: dict[str, tuple[int, int, int]] = {}
        self._newest_ns: dict[str, int] = {}
        # the others' time, to which two have come
        self.others_ns = 0

    def heard(self, sender: str, published_at_ns: int, now_ns: int) -> None:
        """Note a message's way."""
        self._newest_ns[sender] = published_at_ns
        newest = sorted(self._newest_ns.values())[-FEWEST:]
        self.others_ns = max(self.others_ns, newest[0])
        window, ahead_ns = self.others_ns // WINDOW_NS, now_ns - published_at_ns
        last, least_ns, before_ns = self._least.get(sender, (window, ahead_ns, ahead_ns))
        if window == last:
            self._least[sender] = window, min(least_ns, ahead_ns), before_ns
        else:
            self._least[sender] = window, ahead_ns, least_ns if window == last + 1 else ahead_ns

    def ahead_ns(self) -> int | None:
        """How far ahead; below 0 where it is behind, None where too few are heard to tell."""
        window = self.others_ns // WINDOW_NS
        ways = [min(least, before) for last, least, before in self._least.values() if window - last <= 1]
        return min(median_low(ways), median_high(ways), key=abs) if len(ways) >= FEWEST else None


class TrustedTime:
    """The time that a process goes by: its own clock's, or the others' where theirs shows that its own is wrong.

    It never goes back. A clock that leaps forward is not believed until two others are heard, for a process that was stopped
    sees the same: meanwhile it is as late as what is heard. `limit_ns`: by how much a clock may be off.
    """

    def __init__(self, limit_ns: int) -> None:
        self._own = OwnClock()
        self._limit_ns = limit_ns
        self.ahead_ns = 0
        self.wrong = False
        # the clock's time at the last look, and since when a leap has been doubted
        self._clock_ns: int | None = None
        self._leapt_ns: int | None = None
        self._since: set[str] = set()
        self.now_ns = 0

    def heard(self, sender: str, published_at_ns: int, clock_ns: int) -> None:
        """Note a message, heard when this process's clock showed `clock_ns`."""
        self._look(clock_ns)
        self._own.heard(sender, published_at_ns, clock_ns)
        if self._leapt_ns is not None:
            self._since.add(sender)
            self.now_ns = max(self.now_ns, min(published_at_ns, clock_ns))

    def at(self, clock_ns: int) -> int:
        """The time when this process's clock shows `clock_ns`. Afterwards `wrong` says whether the two differ."""
        self._look(clock_ns)
        ahead_ns = self._own.ahead_ns()
        if ahead_ns is not None:
            self.ahead_ns = ahead_ns
            self.wrong = abs(ahead_ns) > (self._limit_ns // 2 if self.wrong else self._limit_ns)
        if self._leapt_ns is not None and (len(self._since) >= FEWEST or clock_ns - self._leapt_ns >= DOUBTED_NS):
            self._leapt_ns = None
        if self._leapt_ns is None:
            self.now_ns = max(self.now_ns, self.right_ns(clock_ns))
        return self.now_ns

    def right_ns(self, clock_ns: int) -> int:
        """What this process's clock should show instead of `clock_ns`, as far as is known."""
        return clock_ns - self.ahead_ns if self.wrong else clock_ns

    @property
    def others_ns(self) -> int:
        """The newest time of which two others were heard."""
        return min(self.now_ns, self._own.others_ns)

    def clock_ns(self, at_ns: int) -> int:
        """What this process's clock shows at a time to come, as far as can be told."""
        return at_ns + ((self._clock_ns or self.now_ns) - self.now_ns)

    def _look(self, clock_ns: int) -> None:
        """Notice a leap of the clock."""
        if self._clock_ns is not None and clock_ns - self._clock_ns > self._limit_ns:
            # what was heard before tells nothing of this clock
            self._leapt_ns, self._own = clock_ns, OwnClock()
            self._since.clear()
        self._clock_ns = clock_ns


class Told:
    """What has been told of a process's clock: that it is wrong, once it has been so for a second; that it is right again."""

    def __init__(self) -> None:
        self._told = False
        self._wrong_ns: int | None = None

    def news(self, wrong: bool, at_ns: int) -> bool | None:
        """Whether the clock is wrong, where that is to be told now; None where it is not."""
        if not wrong:
            self._wrong_ns, told, self._told = None, self._told, False
            return False if told else None
        self._wrong_ns = at_ns if self._wrong_ns is None else self._wrong_ns
        if self._told or at_ns - self._wrong_ns < TOLD_AFTER_NS:
            return None
        self._told = True
        return True
