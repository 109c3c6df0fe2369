"""A balise that the map has in the wrong place is found by its neighbours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import NamedTuple

from .line import Line
from .passage import S_PER_NS, Irregularity

# the probability of naming a balise that lies where the map has it, for each balise that is passed
FALSE_ALARM = 1e-7
# under it the distances to both neighbours, with independent errors, exceed z σ with opposite signs: α = (2 Q(z))²/2
LIMIT_SIGMAS = NormalDist().inv_cdf(1.0 - 0.5 * math.sqrt(2.0 * FALSE_ALARM))
# from the telegram to a belief that surely contains its fix; one that is much older is not used
ENTERED_NS = 100_000_000
OLDEST_NS = 1_000_000_000
# the fix of a misplaced balise bends speeds and scales: until the next balise they add up to as much error again. A sensor of
# position, such as GNSS, draws the state back: up to half
LEAST_AFTER, MOST_AFTER = 0.5, 2.0


class Belief(NamedTuple):
    """The fused mean of [s, v, a] and its covariance (3 x 3) at a time; what follows them is not used."""

    at_ns: int
    mean: Sequence[float]
    covariance: Sequence[Sequence[float]]

    def position_at(self, to_ns: int) -> tuple[float, float]:
        """The position's mean f x and variance f P fᵀ at a nearby time, f = [1, T, T²/2], T in s."""
        T = (to_ns - self.at_ns) * S_PER_NS
        f = (1.0, T, 0.5 * T * T)
        variance = sum(f[i] * f[k] * self.covariance[i][k] for i in range(3) for k in range(3))
        return sum(f[i] * self.mean[i] for i in range(3)), max(variance, 0.0)


@dataclass(slots=True)
class _Passage:
    """A passage and the position that the state gave there with the balise's fix; None while it has not entered."""

    index: int
    at_ns: int
    variance_m2: float
    enters_ns: int
    after: tuple[float, float] | None = None


class _Section(NamedTuple):
    """From one balise to the next: mapped distance less travelled distance, its variance, and what the map leaves open."""

    excess_m: float
    variance_m2: float
    open_m: float

    @property
    def std_m(self) -> float:
        return math.sqrt(self.variance_m2)

    @property
    def agrees(self) -> bool:
        return abs(self.excess_m) <= self.open_m + LIMIT_SIGMAS * self.std_m


@dataclass(slots=True)
class Placement:
    """Compares mapped and travelled distances between neighbouring balises.

    e = (m₂ - m₁) - (ŝ₂⁻ - ŝ₁⁺): m mapped, ŝ₁⁺ the state's position at the first balise with its fix, ŝ₂⁻ at the second
    before its fix, so that a fix that pulled the state is not counted as travel. V = P₂⁻ + R₂ + P₁⁺ + R₁ bounds its variance. A
    balise that is mapped b too far has e = b before it and e = -b, or what the bent state makes of it, behind it; a travelled
    distance that is wrong shows once. Named where both exceed the stated location accuracies and z σ, with opposite signs.
    """

    line: Line
    _belief: Belief | None = field(init=False, default=None)
    _passage: _Passage | None = field(init=False, default=None)
    _section: _Section | None = field(init=False, default=None)
    _step: int = field(init=False, default=0)
    # after a balise is named the state may still be bent: sections are not compared until one agrees
    _bent: bool = field(init=False, default=False)

    def believe(self, belief: Belief, published_ns: int) -> None:
        """Take the next fused state; one that is older than the last is not used."""
        if self._belief is not None and belief.at_ns <= self._belief.at_ns:
            return
        passage = self._passage
        if passage is not None and passage.after is None and min(published_ns, belief.at_ns) >= passage.enters_ns:
            passage.after = belief.position_at(passage.at_ns)
        self._belief = belief

    def passed(self, index: int, at_ns: int, variance_m2: float, now_ns: int) -> Irregularity | None:
        """Take a passage, whose fix is sent at `now_ns`; returns the balise before it, if that is misplaced.

        `index` of the balise on the line, `variance_m2` of the reader.
        """
        belief, last = self._belief, self._passage
        if belief is None or abs(at_ns - belief.at_ns) > OLDEST_NS or (last is not None and at_ns <= last.at_ns):
            self._forget()
            return None
        self._passage = _Passage(index, at_ns, variance_m2, now_ns + ENTERED_NS)
        section = None if last is None else self._between(last, self._passage, belief)
        before, step = self._section, 0 if last is None else index - last.index
        compared = before is not None and section is not None and step == self._step
        self._section, self._step = section, step
        if section is None:
            return None
        if self._bent:
            self._bent = not section.agrees
            self._section = None if self._bent else section
            return None
        if last is None or before is None or not compared or not _opposed(before, section):
            return None
        self._bent, self._section = True, None
        return self._named(last.index, step, before)

    def _forget(self) -> None:
        self._passage, self._section = None, None

    def _between(self, one: _Passage, two: _Passage, belief: Belief) -> _Section | None:
        if abs(two.index - one.index) != 1 or one.after is None:
            return None
        first, second = self.line.balises[one.index], self.line.balises[two.index]
        (start_m, start_m2), (end_m, end_m2) = one.after, belief.position_at(two.at_ns)
        excess_m = second.position_m - first.position_m - (end_m - start_m)
        open_m = first.location_accuracy_m + second.location_accuracy_m + self.line.map_accuracy_m
        return _Section(excess_m, end_m2 + two.variance_m2 + start_m2 + one.variance_m2, open_m)

    def _named(self, index: int, step: int, before: _Section) -> Irregularity:
        balises = self.line.balises
        balise, neighbours = balises[index], f"{balises[index - step].balise_id} and {balises[index + step].balise_id}"
        where = (
            f"{abs(before.excess_m):.2f} ± {before.std_m:.2f} m {'beyond' if before.excess_m > 0.0 else 'short of'} its place"
        )
        text = f"the line has {balise.balise_id} at {balise.position_m:.2f} m, {where}, by the distances from {neighbours}"
        return Irregularity("error", "balise_misplaced", text)


def _opposed(before: _Section, after: _Section) -> bool:
    if before.agrees or after.agrees or before.excess_m * after.excess_m > 0.0:
        return False
    there, back = abs(before.excess_m), abs(after.excess_m)
    slack_m = before.open_m + after.open_m + LIMIT_SIGMAS * math.hypot(MOST_AFTER * before.std_m, after.std_m)
    return LEAST_AFTER * there - slack_m <= back <= MOST_AFTER * there + slack_m
