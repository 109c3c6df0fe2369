"""Which units may be lying: the hypotheses of the bank, and how its rows are taken over."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .evidence import SECONDS_PER_HOUR, Flags, normal_reach, threshold

Units = frozenset[str]
NOBODY: Units = frozenset()
NO_ALTERNATIVES: frozenset[Units] = frozenset()
# a reading may have two rows: the tests of each are apart
CHANNELS = 2
# a state's errors are the same for about so long: as many independent chances of being outside there are in an hour
DECORRELATION_S = 10.0
# where one cause explains all that is seen, another that is so much less likely is not considered
PLAUSIBLE = 0.02
# so many combinations of living rows have their intervals kept
KEPT_INTERVALS = 128
# a suspect that says nothing: it lies where the train moves harder than its motion model says
MOTION_MODEL = "motion-model"
HARD: Units = frozenset((MOTION_MODEL,))


class Suspect(NamedTuple):
    """A unit as a possible liar.

    `fault_probability`: that it lies at any moment, above 0. `readings_per_s`: for the number of tests. `odd_alone`: a single
    odd reading is that reading's fault (a balise in the wrong place), two in a row the unit's. `never_repeats`: no two of its
    readings are the same. `slips`: it is a wheel. `hold`: how many readings in agreement readmit it.
    """

    unit: str
    fault_probability: float
    readings_per_s: float
    odd_alone: bool = False
    never_repeats: bool = False
    slips: bool = False
    hold: int = 10


@dataclass(frozen=True)
class Doubts:
    """What is held possible, and the two budgets.

    `groups`: units that one cause makes lie together, and its probability. `false_alarms_per_hour`: of the whole train.
    `risk_per_hour`: of the truth outside the published interval. `hard_motion_probability`: that the train moves harder than
    its motion model says at any moment, 0: never; its rows are driven by white jerk of `hard_jerk_psd` (m²/s⁵). `speed_units`:
    those that read the train's speed, without which such a row grows and nothing refutes it. `position_units`: those that read
    its position again and again.
    """

    suspects: tuple[Suspect, ...] = ()
    groups: tuple[tuple[Units, float], ...] = ()
    false_alarms_per_hour: float = 0.01
    risk_per_hour: float = 1e-4
    hard_motion_probability: float = 0.0
    hard_jerk_psd: float = 50.0
    speed_units: Units = NOBODY
    position_units: Units = NOBODY
    by_unit: Mapping[str, Suspect] = field(init=False, repr=False, compare=False)
    threshold: float = field(init=False, repr=False, compare=False)
    _causes: tuple[tuple[Units, float], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_unit", {s.unit: s for s in self.suspects})
        rate = sum(s.readings_per_s for s in self.suspects)
        object.__setattr__(self, "threshold", threshold(self.false_alarms_per_hour, rate))
        causes = [(frozenset((s.unit,)), s.fault_probability) for s in self.suspects] + list(self.groups)
        if self.suspects and self.hard_motion_probability > 0.0:
            causes.append((HARD, self.hard_motion_probability))
        object.__setattr__(self, "_causes", tuple(causes))

    def sets(self, excluded: Units) -> tuple[dict[Units, float], dict[Units, float]]:
        """The hypotheses beside a set of excluded units, and the probability of each.

        First just these, and one cause more (a unit, or a group); then two causes more. Those are not published, but what they
        never heard is not lost when one unit is excluded, or the train brakes hard, while another one lies unseen.
        """
        single: dict[Units, float] = {excluded: 1.0}
        pairs: dict[Units, float] = {}
        for units, p in self._causes:
            # a common cause of these and of some that are excluded may be likelier
            common = self.chance(excluded | units) / self.chance(excluded) if excluded else p
            single.setdefault(excluded | units, min(1.0, max(p, common)))
        for (one, p), (other, q) in combinations(self._causes, 2):
            if excluded | one | other not in single:
                pairs.setdefault(excluded | one | other, p * q)
        return single, pairs

    def chance(self, units: Units) -> float:
        """The probability that just these lie, by the likeliest causes that together are these."""
        if not units:
            return 1.0
        first = min(units)
        fitting = [(cause, p) for cause, p in self._causes if first in cause and cause <= units]
        return max((p * self.chance(units - cause) for cause, p in fitting), default=0.0)

    @property
    def single_causes(self) -> frozenset[Units]:
        """What one cause makes lie."""
        return frozenset(units for units, _ in self._causes)

    @property
    def risk(self) -> float:
        """The risk of one decorrelation time."""
        return self.risk_per_hour * DECORRELATION_S / SECONDS_PER_HOUR


class Rows:
    """The rows of a bank: which units each leaves out, which it uses, and how far its interval reaches.

    Row 0 leaves out `excluded` alone. `blamed`: what is excluded, or was a short while ago. `alternatives`: other explanations
    of why it was, not refuted so far, which are as likely as they are beside that; what is blamed may as well lie again.
    `several` (H): those of several causes. `near` (H): these, and the rows of at most one cause more than is excluded.
    `hard`: the places of the rows for a train that moves harder than its motion model, which are the last ones.
    `deaf`: the rows that hear no unit which reads the speed, nor the position again and again.
    """

    def __init__(
        self, doubts: Doubts, excluded: Units, alternatives: frozenset[Units] = NO_ALTERNATIVES, blamed: Units = NOBODY
    ) -> None:
        self.doubts, self.excluded, self.alternatives = doubts, excluded, alternatives
        self.blamed = blamed or excluded
        single, pairs = doubts.sets(excluded)
        otherwise = alternatives - single.keys()
        for units in sorted(otherwise, key=sorted):
            pairs[units] = doubts.chance(units) / doubts.chance(self.blamed)
        chances = {**single, **pairs}
        if self.blamed > excluded:
            # what lay a short while ago is as likely to lie again
            chances.update(
                (units, doubts.chance(units) / doubts.chance(self.blamed)) for units in chances if units >= self.blamed
            )
        self.sets = tuple(sorted(chances, key=lambda units: MOTION_MODEL in units))
        self.chances = np.array([chances[units] for units in self.sets])
        self.near = np.array([units in single or units in otherwise for units in self.sets])
        several = otherwise - doubts.single_causes
        self.several = np.array([units in several for units in self.sets])
        self._onward = np.array([units >= excluded or units - excluded <= HARD for units in self.sets])
        self.hard = range(sum(MOTION_MODEL not in units for units in self.sets), len(self.sets))
        followed = doubts.speed_units | doubts.position_units
        self.deaf = np.array([not followed - units for units in self.sets])
        self.places = {units: i for i, units in enumerate(self.sets)}
        self._uses: dict[str, Flags] = {}
        self._channels: dict[int, tuple[int, ...]] = {}
        self._intervals: dict[tuple[bytes, int, int], tuple[Flags, NDArray[np.float64]]] = {}

    def uses(self, unit: str) -> Flags:
        """Whether each row uses a unit."""
        flags = self._uses.get(unit)
        if flags is None:
            flags = self._uses[unit] = np.array([unit not in units for units in self.sets])
        return flags

    def channels(self, row: int) -> tuple[int, ...]:
        """The channels of the units that a row uses."""
        kept = self._channels.get(row)
        if kept is None:
            suspects = enumerate(self.doubts.suspects)
            used = [i for i, suspect in suspects if suspect.unit not in self.sets[row]]
            kept = self._channels[row] = tuple(CHANNELS * i + component for i in used for component in range(CHANNELS))
        return kept

    def published(self, alive: Flags) -> Flags:
        """The rows whose intervals are published together.

        Those near to what is excluded; once row 0 is refuted all that may lead, and all that are likely enough, what explains
        an exclusion otherwise too. Two causes at once, both not found yet, are left to the tests, as long as nothing was
        excluded that they would explain.
        """
        return alive & self.near if alive[0] else self._likely(alive) | self.plausible(alive)

    def intervals(self, alive: Flags, leader: int, rarity: int = 0) -> tuple[Flags, NDArray[np.float64]]:
        """The published rows (H), the leading one among them, and K of each of these.

        Σ p_h · 2 Φ(-K_h) is the risk of one decorrelation time; the published rows share it evenly. p_h is 1 for row 0 and the
        probability of its faults for each other row, and relative to the likeliest once row 0 is refuted. Where noise makes the
        tests of the leading row as bad in one of 10ʳ cases (`rarity`), each other row is so much likelier, up to the likeliest.
        """
        key = alive.tobytes(), leader, rarity
        kept = self._intervals.get(key)
        if kept is None:
            if len(self._intervals) >= KEPT_INTERVALS:
                self._intervals.clear()
            published = self.published(alive)
            published[leader] = True
            likeliest = self.chances[published].max(initial=0.0)
            risk = self.doubts.risk * likeliest / max(1, int(published.sum()))
            chances = np.minimum(self.chances[published] * 10.0**rarity, likeliest)
            kept = published, np.array([normal_reach(risk / p) for p in chances])
            self._intervals[key] = kept
        return kept

    def plausible(self, alive: Flags) -> Flags:
        """The rows alive from which one may be chosen, not far less likely from the outset than another one.

        What explains an exclusion otherwise is asked only where nothing is left that goes on from it.
        """
        return self._likely(alive & self._onward if (alive & self._onward).any() else alive)

    def _likely(self, rows: Flags) -> Flags:
        return np.asarray(rows & (self.chances > PLAUSIBLE * self.chances[rows].max(initial=0.0)))

    def smallest(self, rows: Flags) -> int | None:
        """The row of these whose set is contained in that of every other; None where they contradict each other."""
        living = np.flatnonzero(rows).tolist()
        least = min(living, key=lambda i: len(self.sets[i]))
        return least if all(self.sets[least] <= self.sets[i] for i in living) else None


def sources(new: Rows, old: Rows, alive: Flags, wanted: Callable[[Units], Iterable[Units]], otherwise: int) -> list[int]:
    """For each new row, the old row that it continues: the first of `wanted` that is alive, else the row `otherwise`."""
    out = []
    for units in new.sets:
        found = (old.places[w] for w in wanted(units) if w in old.places and alive[old.places[w]])
        out.append(next(found, otherwise))
    return out
