"""A sensor's noise variance from its innovations."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from ..layout import Array
from .learner import Judged, Seen


class Mean(NamedTuple):
    """R̂ before its factor, the weight of what it is a mean of, and its floor, each (m)."""

    mean: Array
    weight: Array
    floor: Array


class InnovationVariance:
    """R̂ from the innovations: R̂ = mean(e² - c) over the memory, not below a floor.

    e = z - h x̂ and c = h P hᵀ of each observation, so that E[e²] = c + R (Mehra 1970; Mohamed and Schwarz 1999 over a
    window). Each counts (R/(R + c))², the information that e² has on R, R the greater of R̂ and e² - c: a badly
    predicted reading says little about its noise, unless it is farther off than the prediction can be. The mean runs over
    all observations until there are `memory` of them, then forgets exponentially; it begins with the stated R, which has
    the weight of `start_weight` observations. R̂ is not below `floor` times the stated R, because a few small innovations
    must not make a reading certain. Stated is R̂ (n + 2)/n for the effective number n of observations: it is itself
    uncertain, and E[1/R̂] > 1/R.
    """

    needs_belief: ClassVar[bool] = True

    def __init__(self, memory: int, floor: float, start_weight: float = 4.0) -> None:
        self._memory, self._floor, self._start_weight = float(memory), floor, start_weight

    def begin(self, variance: Array) -> Mean:
        """R̂ is the stated R."""
        return Mean(variance, np.full_like(variance, self._start_weight), self._floor * variance)

    def take(self, memory: Mean, dt_s: float, seen: Seen) -> tuple[Judged, Mean]:  # noqa: ARG002
        """The reading with R̂ after its innovation e of predicted variance c."""
        mean, weight, floor = memory
        c = seen.predicted
        found = seen.innovation * seen.innovation - c
        # a large innovation suggests a greater R, about which it holds more information than about the present one
        R = np.maximum(np.maximum(mean, floor), found)
        counts = (R / (R + c)) ** 2
        weight = np.minimum(weight + counts, self._memory)
        memory = Mean(mean + (found - mean) * counts / weight, weight, floor)
        return self.judge(memory, seen), memory

    def judge(self, memory: Mean, seen: Seen) -> Judged:
        """The reading with R̂."""
        mean, weight, floor = memory
        # an exponential memory of weight w averages as well as a window of 2 w
        n = np.where(weight < self._memory, weight, 2.0 * self._memory)
        return Judged(seen.value, np.maximum(mean, floor) * (n + 2.0) / n)
