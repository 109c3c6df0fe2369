"""Sensors' observers as judges in the fuser's timeline: their memory is an argument and a result of each call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import Array
from milepost.estimation.noise.learner import Learner
from milepost.fusion.readings import LinearRow, StackedRow
from milepost.sensors.base import Sensor
from milepost.sensors.observed import Belief
from milepost_schemas import Message

# a valid message may still hold values that the arithmetic cannot use
UNUSABLE = (ArithmeticError, np.linalg.LinAlgError, ValueError)
LEAST_VARIANCE, LARGEST_VARIANCE = 1e-12, 1e15


class UnitJudge:
    """How the fuser observes one unit. `message` is the schema of its readings; `pure`: nothing is remembered.

    `learner`: how the noise of its readings is learned; None where it is as stated.
    """

    def __init__(self, sensor: Sensor[Any], message: type[Message], learner: Learner | None = None) -> None:
        self._sensor, self._observer = sensor, sensor.model()
        self.message, self.pure = message, self._observer is sensor
        self.learner = learner
        self._start = self._observer.memory

    def start(self) -> Any:
        """The memory before the first reading."""
        return self._start

    def restart(self) -> Any:
        """The memory after a restart on a running train."""
        self._observer.memory = self._start
        self._observer.restarted()
        return self._observer.memory

    def judge(
        self, memory: Any, reading: Any, mean: Array, covariance: Array
    ) -> tuple[Sequence[LinearRow], Any, str | None, str | None]:
        """A reading's rows, the memory after it, the reason for gating, and the reason for which the reading is refused."""
        observer = self._observer
        observer.memory = memory
        try:
            rows = observer.observe(reading, Belief(mean, covariance))
        except UNUSABLE:
            return (), memory, None, "unusable"
        finally:
            observer.notices()  # discarded: the observer in the filter's process reports them
        if not all(math.isfinite(value) and LEAST_VARIANCE <= R <= LARGEST_VARIANCE for _, value, R in rows):
            return (), memory, None, "unusable"
        return rows, observer.memory, observer.gating, observer.refused

    def each(self, reading: Any, beliefs: Beliefs) -> Sequence[StackedRow] | None:
        """A reading's rows at each of H beliefs, from a sensor that remembers nothing; None where one is not usable.

        No row: it tells nothing, as a speed without a sign at a stop.
        """
        try:
            rows = self._sensor.observe_each(reading, beliefs)
        except UNUSABLE:
            return None
        return rows if all([_usable(row.value, row.variance) for row in rows]) else None  # noqa: C419 (a list is faster here)


def _usable(value: Array | float, variance: Array | float) -> bool:
    """Whether values are finite and variances within limits."""
    # methods of an array take three times as long as these
    many = isinstance(variance, np.ndarray)
    least, largest = (np.minimum.reduce(variance), np.maximum.reduce(variance)) if many else (variance, variance)
    # a sum is finite where every value is
    total = np.add.reduce(value) if isinstance(value, np.ndarray) else value
    return math.isfinite(total) and bool(least >= LEAST_VARIANCE and largest <= LARGEST_VARIANCE)
