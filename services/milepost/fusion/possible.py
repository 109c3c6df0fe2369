"""What the bank holds possible, for people: the belief of each hypothesis, and what is thought of it."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from .bank_state import Bank, rarity

Judgement = Literal["leads", "held", "unlikely", "refuted"]


class Possible(NamedTuple):
    """A hypothesis: the units that it leaves out, and (mean, standard deviation) of its position in m and speed in m/s."""

    without: tuple[str, ...]
    judgement: Judgement
    position: tuple[float, float]
    speed: tuple[float, float]


def possible(bank: Bank) -> list[Possible]:
    """The hypotheses of what is excluded and of one cause more, and others whose intervals are published.

    Those that leave out least come first.
    """
    held, _ = bank.rows.intervals(bank.alive, bank.leader, rarity(bank))
    shown = np.flatnonzero(bank.rows.near | held).tolist()
    found = [_of(bank, row, bool(held[row])) for row in shown]
    return sorted((each for each in found if each is not None), key=lambda each: (len(each.without), each.without))


def _of(bank: Bank, row: int, held: bool) -> Possible | None:
    """None where a hypothesis that was refuted long ago cannot be computed with any more."""
    s, v = bank.x[row, :2].tolist()
    variances = np.diagonal(bank.P[row])[:2].tolist()
    if not all(map(math.isfinite, (s, v, *variances))):
        return None
    position_std, speed_std = (math.sqrt(max(variance, 0.0)) for variance in variances)
    without = tuple(sorted(bank.rows.sets[row]))
    return Possible(without, _judgement(bank, row, held), (s, position_std), (v, speed_std))


def _judgement(bank: Bank, row: int, held: bool) -> Judgement:
    if row == bank.leader:
        return "leads"
    if held:
        return "held"
    return "unlikely" if bank.alive[row] else "refuted"
