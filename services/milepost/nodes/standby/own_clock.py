"""Whether a process's own clock is right, by the stamps of what it hears."""

from __future__ import annotations

from statistics import median_high, median_low

# a message that waited for a busy machine is no sign of a clock that is ahead: the fastest of so long counts
WINDOW_NS = 250_000_000
# one sender may as well be wrong itself
FEWEST = 2


class OwnClock:
    """By how much this process's clock is ahead of most others'; a link that delays everything looks the same.

    Of each sender the least (time here - time of publishing) over the last one to two windows; of these, the median, and of
    two in the middle the one nearer to 0: more than half must be off.
    """

    def __init__(self) -> None:
        # by sender: the window, the least in it, and in the one before
        self._least: dict[str, tuple[int, int, int]] = {}

    def heard(self, sender: str, published_at_ns: int, now_ns: int) -> None:
        """Note a message's way."""
        window, ahead_ns = now_ns // WINDOW_NS, now_ns - published_at_ns
        last, least_ns, before_ns = self._least.get(sender, (window, ahead_ns, ahead_ns))
        if window == last:
            self._least[sender] = window, min(least_ns, ahead_ns), before_ns
        else:
            self._least[sender] = window, ahead_ns, least_ns if window == last + 1 else ahead_ns

    def ahead_ns(self, now_ns: int) -> int:
        """How far ahead; below 0 where it is behind, 0 where too few are heard to tell."""
        window = now_ns // WINDOW_NS
        ways = [min(least, before) for last, least, before in self._least.values() if window - last <= 1]
        return min(median_low(ways), median_high(ways), key=abs) if len(ways) >= FEWEST else 0
