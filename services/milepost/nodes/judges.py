"""Sensors' observers as judges in the fuser's timeline: their memory is an argument and a result of each call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from milepost.estimation.judging import LinearRow
from milepost.estimation.layout import Array
from milepost.sensors.base import Belief, Observer
from milepost_schemas import Message

# a valid message may still hold values that the arithmetic cannot use
UNUSABLE = (ArithmeticError, np.linalg.LinAlgError, ValueError)
LEAST_VARIANCE, LARGEST_VARIANCE = 1e-12, 1e15


class UnitJudge:
    """One unit's observer. `message` is the schema of its readings."""

    def __init__(self, observer: Observer, message: type[Message]) -> None:
        self.message = message
        self._observer = observer
        self._start = observer.memory

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
