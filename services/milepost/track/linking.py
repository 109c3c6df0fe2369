"""Balise linking: where each balise of the line is expected, and what is wrong with a telegram or with the lack of one."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass, field

from .line import Line
from .passage import Interval, Irregularity, Taken, Telegram

# the vital accuracy of a balise reader, SUBSET-036; where a reader states a larger error, that many of its sigmas
READING_M = 1.0
READING_SIGMAS = 5.0
# the greatest latency that a reader's options may state: a telegram that is older was not sent in time
LATENCY_NS = 1_000_000_000
# SUBSET-041: what is older than 1 s is stale. Without a fresh interval nothing is expected
STALE_NS = 1_000_000_000
KEPT_NS = 10_000_000_000
KEPT_TELEGRAMS = 64
MISSED_IN_A_ROW = 2


@dataclass(slots=True)
class Linking:
    """Follows the published interval along the line; nothing is expected while there is no fresh one.

    The window of a balise opens when the interval's front may have reached it, and closes when its rear has surely passed
    it: the balise's location accuracy and the reader's tolerance are added at both ends, and a telegram may come later by
    the reader's latency. Source: SUBSET-026 3.4.4.4 and 3.6.4.
    """

    line: Line
    _positions: list[float] = field(init=False)
    _recent: deque[Interval] = field(init=False, default_factory=deque)
    # the side of each balise on which the train surely was last: -1 before it, 1 beyond it, 0 not known
    _sides: list[int] = field(init=False, default_factory=list)
    # the range of balises that the last interval was near, and of these the ones whose window is open
    _near: tuple[int, int] = field(init=False, default=(0, 0))
    _open: set[int] = field(init=False, default_factory=set)
    _read: set[int] = field(init=False, default_factory=set)
    _overdue: dict[int, tuple[int, Interval]] = field(init=False, default_factory=dict)
    _last: tuple[int, int] | None = field(init=False, default=None)
    _under: dict[str, tuple[int, int]] = field(init=False, default_factory=dict)
    _told: set[tuple[str, int]] = field(init=False, default_factory=set)
    _taken: deque[tuple[str, int, int]] = field(init=False, default_factory=lambda: deque(maxlen=KEPT_TELEGRAMS))
    _missed: list[str] = field(init=False, default_factory=list)
    _farthest_m: float = field(init=False)

    def __post_init__(self) -> None:
        self._positions = [b.position_m for b in self.line.balises]
        self._farthest_m = READING_M + max((b.location_accuracy_m for b in self.line.balises), default=0.0)

    def follow(self, interval: Interval) -> list[Irregularity]:
        """Take the next published interval; returns the balises that were missed by its time."""
        before = self._recent[-1] if self._recent else None
        if before is not None and interval.at_ns <= before.at_ns:
            return []
        if before is None or not _continues(before, interval):
            self._begin(interval)
        self._recent.append(interval)
        while interval.at_ns - self._recent[0].at_ns > KEPT_NS:
            self._recent.popleft()
        self._move(interval)
        due = [i for i, (closed_ns, _) in self._overdue.items() if interval.at_ns - closed_ns > LATENCY_NS]
        return [told for i in due for told in self._miss(i, self._overdue.pop(i)[1])]

    def interval_at(self, at_ns: int) -> Interval | None:
        """The interval carried to a time from the nearest published one; None where none is fresh then."""
        place = bisect_right(self._recent, at_ns, key=lambda known: known.at_ns)
        nearest = self._recent[max(0, place - 1)] if self._recent else None
        return nearest.carried(at_ns) if nearest and abs(at_ns - nearest.at_ns) <= STALE_NS else None

    def take(self, telegram: Telegram) -> Taken:
        """What is irregular about a telegram, and whether it is one more passage over the balise that it names."""
        identity = (telegram.reader, telegram.balise, telegram.at_ns)
        interval = self.interval_at(telegram.at_ns)
        if interval is None or identity in self._taken:
            return Taken([], False)
        self._taken.append(identity)
        found = self._irregular(telegram, interval)
        # early or late, it is still that balise: the sequence goes on from it
        passed = found is None or found.code in ("balise_early", "balise_late")
        again = self._last is not None and self._last[0] == telegram.balise
        out = self._passed(telegram, interval) if passed else []
        if found is not None:
            # what is told already is doubtful again, but no second event
            told = (found.code, telegram.balise) in self._told
            self._told.add((found.code, telegram.balise))
            out.append(found._replace(text="") if told else found)
        return Taken(out, passed and not again)

    def _begin(self, interval: Interval) -> None:
        """Expect from here on: whatever was before does not link with this interval."""
        self._recent.clear()
        self._sides = [self._side(i, interval) for i in range(len(self._positions))]
        self._near = self._range(interval)
        self._open = {i for i in range(*self._near) if self._sides[i] == 0}
        for known in (self._read, self._overdue, self._under, self._told):
            known.clear()
        self._last = None

    def _range(self, interval: Interval) -> tuple[int, int]:
        near_m, far_m = interval.low_m - self._farthest_m, interval.high_m + self._farthest_m
        return bisect_left(self._positions, near_m), bisect_right(self._positions, far_m)

    def _tolerance_m(self, index: int, variance_m2: float = 0.0) -> float:
        return self.line.balises[index].location_accuracy_m + max(READING_M, READING_SIGMAS * math.sqrt(variance_m2))

    def _side(self, index: int, interval: Interval) -> int:
        outside_m = self._outside_m(index, interval)
        return 0 if outside_m == 0.0 else -1 if outside_m > 0.0 else 1

    def _outside_m(self, index: int, interval: Interval, variance_m2: float = 0.0) -> float:
        """How far ahead of the window's opening (> 0) or behind its closing (< 0) the balise lies; 0 inside."""
        at_m, tolerance_m = self._positions[index], self._tolerance_m(index, variance_m2)
        return max(0.0, at_m - interval.high_m - tolerance_m) + min(0.0, at_m - interval.low_m + tolerance_m)

    def _move(self, interval: Interval) -> None:
        first, last = self._range(interval)
        for i in range(min(first, self._near[0]), max(last, self._near[1])):
            side = self._side(i, interval)
            if side == 0:
                self._open.add(i)
            elif i in self._open or side != self._sides[i]:
                self._close(i, side, interval)
        self._near = first, last

    def _close(self, index: int, side: int, interval: Interval) -> None:
        # a train that turned round in the window, or was in it from the beginning, need not have passed the balise
        if side == -self._sides[index] and index not in self._read:
            self._overdue[index] = interval.at_ns, interval
        self._sides[index] = side
        self._open.discard(index)
        self._read.discard(index)
        self._under = {reader: under for reader, under in self._under.items() if under[0] != index}

    def _miss(self, index: int, closed: Interval) -> list[Irregularity]:
        balise = self.line.balises[index]
        self._missed.append(balise.balise_id)
        text = f"{balise.balise_id} at {balise.position_m:.2f} m was not read: {closed} when its window closed"
        if len(self._missed) < MISSED_IN_A_ROW:
            return [Irregularity("warning", "balise_missed", text)]
        if len(self._missed) > MISSED_IN_A_ROW:
            return []
        fault = f"{' and '.join(self._missed)} were missed in a row: the reader or the line's data are at fault"
        return [Irregularity("warning", "balise_missed", text), Irregularity("error", "balises_missed", fault)]

    def _passed(self, telegram: Telegram, interval: Interval) -> list[Irregularity]:
        index, missed = telegram.balise, len(self._missed)
        if self._last is None or self._last[0] != index:
            self._told.clear()
        self._missed.clear()
        self._last = index, telegram.at_ns
        if self._overdue.pop(index, None) is None:
            # one that is read early counts when its window closes
            self._read.add(index)
            if index in self._open:
                self._under[telegram.reader] = index, interval.direction
        if missed < MISSED_IN_A_ROW:
            return []
        name = self.line.balises[index].balise_id
        return [Irregularity("info", "balises_read_again", f"{telegram.reader} read {name} after {missed} missed balises")]

    def _irregular(self, telegram: Telegram, interval: Interval) -> Irregularity | None:
        index, outside_m = telegram.balise, self._outside_m(telegram.balise, interval, telegram.variance_m2)
        direction, balise = interval.direction, self.line.balises[telegram.balise]
        said = f"{telegram.reader} read {balise.balise_id} at {balise.position_m:.2f} m, {interval}"
        ahead = 0
        # a telegram that comes after a later one is late, not out of order
        if self._last is not None and telegram.at_ns >= self._last[1]:
            last = self.line.balises[self._last[0]].balise_id
            ahead = (index - self._last[0]) * direction
            if ahead < 0:
                return _doubt("balise_wrong_direction", said, f"against the direction of travel after {last}")
        if ahead > 1 and (skipped := self._skipped(index, interval)):
            return _doubt("balise_out_of_order", said, f"before {skipped}")
        if outside_m == 0.0:
            if direction and self._under.get(telegram.reader) == (index, direction):
                return _doubt("balise_repeated", said, "read again by a train that moves")
            return None
        between = (interval.high_m, balise.position_m) if outside_m > 0.0 else (balise.position_m, interval.low_m)
        others = bisect_left(self._positions, between[1]) - bisect_right(self._positions, between[0])
        if others > 0:
            return _doubt("balise_unexpected", said, f"{abs(outside_m):.2f} m outside its window, beyond another balise")
        early = (outside_m > 0.0) == (interval.slow_mps + interval.fast_mps >= 0.0)
        code, when = ("balise_early", "before") if early else ("balise_late", "behind")
        return _doubt(code, said, f"{abs(outside_m):.2f} m {when} its window")

    def _skipped(self, index: int, interval: Interval) -> str | None:
        """The first balise between the last one read and this one that may still come."""
        step = interval.direction
        between = range(self._last[0] + step, index, step) if self._last else ()
        open_yet = (i for i in between if i not in self._read and self._side(i, interval) != step)
        return next((self.line.balises[i].balise_id for i in open_yet), None)


def _continues(before: Interval, interval: Interval) -> bool:
    """Whether the interval is fresh and touches the last one, carried to its time; it does not after a restart or reset."""
    if interval.at_ns - before.at_ns > STALE_NS:
        return False
    carried = before.carried(interval.at_ns)
    return interval.low_m <= carried.high_m and interval.high_m >= carried.low_m


def _doubt(code: str, said: str, detail: str) -> Irregularity:
    return Irregularity("warning", code, f"{said}: {detail}", f"{code}: {detail}")
