"""What an excluded unit does while the others go on: whether its error stays, grows, or comes and goes."""

from __future__ import annotations

import math
from typing import NamedTuple

from milepost.estimation.time_units import S_PER_NS

# the error is looked at in blocks of at least so many readings and so long
BLOCK, BLOCK_S = 4, 0.4
# a block's mean innovation in σ beyond which the unit is wrong, and below which it is right
WRONG, RIGHT = 3.0, 1.0
# a mean that is so many of its own standard deviations away from 0 is no noise
CERTAIN = 4.0
# an error that came so often within so long, each time within so many blocks of being right: intermittent
AGAIN, AGAIN_NS, ABRUPT = 3, 300_000_000_000, 2
# so many blocks in a row with an error of the same sign: it is no noise
STEADY = 3
# a drift: blocks on a line whose slope is so many of its standard deviations, with which the error grew by this part
LEAST_BLOCKS, STEEP, GROWN = 8, 6.0, 0.3


class Line(NamedTuple):
    """The straight line y = a + b t through points, by sums over them: Σ1, Σt, Σt², Σy, Σty, Σy²."""

    n: int = 0
    t: float = 0.0
    tt: float = 0.0
    y: float = 0.0
    ty: float = 0.0
    yy: float = 0.0

    def through(self, t: float, y: float) -> Line:
        """The line with one point more."""
        return Line(self.n + 1, self.t + t, self.tt + t * t, self.y + y, self.ty + t * y, self.yy + y * y)

    @property
    def spread(self) -> float:
        """S_tt = Σt² - (Σt)²/n."""
        return self.tt - self.t * self.t / self.n

    @property
    def slope(self) -> tuple[float, float]:
        """b = S_ty/S_tt and its standard deviation √((S_yy - b S_ty)/((n - 2) S_tt)); n > 2."""
        S_tt, S_ty, S_yy = self.spread, self.ty - self.t * self.y / self.n, self.yy - self.y * self.y / self.n
        b = S_ty / S_tt
        return b, math.sqrt(max(0.0, S_yy - b * S_ty) / ((self.n - 2) * S_tt))

    def at(self, t: float) -> float:
        """y at t."""
        return self.y / self.n + self.slope[0] * (t - self.t / self.n)


class Block(NamedTuple):
    """Readings in a row: how many, since when, and the sums of their innovations e in σ and of e²."""

    n: int = 0
    since_s: float = 0.0
    e: float = 0.0
    ee: float = 0.0


class Course(NamedTuple):
    """The innovations of a unit since it was excluded, in σ of the hypothesis that leaves it out.

    `excluded_ns`: when it was; `heard_ns`: the last reading; `block`: the readings that fill no block yet; `line`: through the
    means of the blocks; `scatter`, `freedom`: of the readings in them around these means. `right_ago`: how many
    blocks ago it was right; `wrong_ns`: when it was suddenly wrong, the last times; `steady`: so many blocks in a row have an
    error of this sign. `kind` and `evidence`: what it was found to do.
    """

    excluded_ns: int = 0
    heard_ns: int = 0
    block: Block = Block()
    line: Line = Line()
    scatter: float = 0.0
    freedom: int = 0
    right_ago: int = 0
    wrong_ns: tuple[int, ...] = ()
    steady: int = 0
    kind: str | None = None
    evidence: str = ""

    def excluded(self, at_ns: int, sudden: bool) -> Course:
        """The course of a unit that is excluded at a time, perhaps again; `sudden`: a few readings told."""
        if at_ns == self.excluded_ns:
            return self
        begun = Course(at_ns, at_ns, wrong_ns=self.wrong_ns)
        return begun._suddenly_wrong() if sudden else begun

    def heard(self, at_ns: int, e: float) -> Course:
        """The course after one innovation e in σ; of several rows of a reading the first counts."""
        if at_ns <= self.heard_ns or not math.isfinite(e):
            return self
        t, block = (at_ns - self.excluded_ns) * S_PER_NS, self.block
        block = Block(block.n + 1, block.since_s if block.n else t, block.e + e, block.ee + e * e)
        course = self._replace(heard_ns=at_ns, block=block)
        return course._closed(t) if block.n >= BLOCK and t - block.since_s >= BLOCK_S else course

    def _closed(self, t: float) -> Course:
        n, since_s, total, squares = self.block
        mean = total / n
        scatter, freedom = self.scatter + squares - total * mean, self.freedom + n - 1
        course = self._replace(
            block=Block(), line=self.line.through(0.5 * (since_s + t), mean), scatter=scatter, freedom=freedom
        )
        certain = abs(mean) > max(WRONG, CERTAIN * math.sqrt(max(1.0, scatter / freedom) / n))
        sign = int(math.copysign(1, mean))
        course = course._replace(steady=sign * (1 + max(0, sign * self.steady)) if certain else 0)
        if abs(mean) < RIGHT:
            course = course._replace(right_ago=0)
        elif certain:
            course = course._suddenly_wrong()
        else:
            course = course._replace(right_ago=self.right_ago + 1)
        if course.kind in (None, "biased"):
            course = course._drifting(t, scatter / freedom / n)
        if course.kind is None and abs(course.steady) >= STEADY:
            told = f"its last {STEADY} means over {n} readings are {mean:+.1f} σ or so"
            course = course._replace(kind="biased", evidence=told)
        return course

    def _suddenly_wrong(self) -> Course:
        """Noted, unless it has been wrong for longer or became so slowly."""
        if self.right_ago >= ABRUPT:
            return self
        wrong_ns = (*self.wrong_ns, self.heard_ns)[-AGAIN:]
        course = self._replace(wrong_ns=wrong_ns, right_ago=ABRUPT)
        if len(wrong_ns) < AGAIN or wrong_ns[-1] - wrong_ns[0] > AGAIN_NS:
            return course
        told = f"it was wrong {AGAIN} times within {(wrong_ns[-1] - wrong_ns[0]) * S_PER_NS:.1f} s, and right in between"
        return course._replace(kind="intermittent", evidence=told)

    def _drifting(self, t: float, variance: float) -> Course:
        """It drifts where its blocks are on a line; `variance`: of a block's mean, by the scatter of its readings."""
        if self.line.n < LEAST_BLOCKS:
            return self
        slope, std = self.line.slope
        std = max(std, math.sqrt(variance / self.line.spread))
        first, last = self.line.at(0.0), self.line.at(t)
        if abs(slope) <= STEEP * std or abs(last) - abs(first) < GROWN * abs(0.5 * (first + last)):
            return self
        told = f"its error grew from {first:+.1f} to {last:+.1f} σ in {t:.1f} s"
        return self._replace(kind="drifting", evidence=told)
