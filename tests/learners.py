"""A learner of noise, fed by hand at one belief."""

from __future__ import annotations

from typing import Any

import numpy as np

from milepost.estimation.noise.learner import Learned, Learner, Seen, learned
from milepost.estimation.time_units import NS_PER_S


def seen(value: Any, stated: Any = 1.0, innovation: Any = 0.0, predicted: Any = 0.0) -> Seen:
    """An observation at one belief, or at as many as there are numbers."""
    return Seen(*(np.atleast_1d(np.asarray(number, dtype=float)) for number in (value, stated, innovation, predicted)))


class Fed:
    """A learner, what it has learned, and the time of the last reading. `stated`: R of every reading."""

    def __init__(self, learner: Learner, stated: float) -> None:
        self.learner, self._stated = learner, stated
        self._at_ns, self._last = 0, None

    @property
    def memory(self) -> Any:
        return self._last.memory

    def take(self, innovation: float, predicted: float = 0.0, dt_s: float = 0.0) -> tuple[float, float]:
        """z' and R' of a reading whose expected value is 0."""
        self._at_ns += round(dt_s * NS_PER_S)
        judged, self._last = learned(
            self.learner, self._last, self._at_ns, seen(innovation, self._stated, innovation, predicted)
        )
        return float(judged.value[0]), float(judged.variance[0])

    def judge(self, innovation: float, predicted: float) -> tuple[float, float]:
        """The same without learning from it."""
        judged = self.learner.judge(self.memory, seen(innovation, self._stated, innovation, predicted))
        return float(judged.value[0]), float(judged.variance[0])

    def start(self, at_ns: int, memory: Any) -> None:
        """Continue from a memory."""
        self._at_ns, self._last = at_ns, Learned(at_ns, memory)
