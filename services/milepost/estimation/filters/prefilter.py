"""Pre-filters: smoothers of a reading's value before a Kalman filter."""

from __future__ import annotations

from typing import Protocol

from ..observation import Observation
from .base import O
from .learning import LearningFilter


class Smoother(Protocol):
    """A pre-filter on one component of a reading."""

    @property
    def variance(self) -> float: ...
    def step(self, dt_s: float, value: float) -> tuple[float, float]: ...


class PreFilter(LearningFilter[O, Smoother]):
    """Passes on smoothed readings with R_eff; a late reading passes unchanged, with the variance of a reading now.

    The belief is not used, so the observations do not depend on feedback.
    """

    def learn(self, learner: Smoother, observation: Observation, dt_s: float) -> Observation:
        """The smoothed reading."""
        value, variance = learner.step(dt_s, observation.value)
        return observation._replace(value=value, variance=variance)

    def judge(self, learner: Smoother, observation: Observation) -> Observation:
        """The reading with its value unchanged."""
        return observation._replace(variance=learner.variance)
