"""The adaptive Kalman filter: R from the innovations."""

from __future__ import annotations

from dataclasses import dataclass

from ..noise.adaptive import InnovationVariance
from ..observation import Observation
from .learning import LearningFilter
from .options import positive


@dataclass(frozen=True)
class AdaptiveKalmanOptions:
    """`memory`: readings over which R is estimated; `floor`: R̂ is at least this share of the stated R."""

    memory: int = 50
    floor: float = 0.25

    def __post_init__(self) -> None:
        positive(self, "memory", "floor")


class AdaptiveKalmanFilter(LearningFilter[AdaptiveKalmanOptions, InnovationVariance]):
    """States R̂ = mean(e² - h P hᵀ) for each component of a reading (see `adaptive.InnovationVariance`)."""

    kind = "adaptive_kalman"
    options_model = AdaptiveKalmanOptions

    def learner(self, observation: Observation) -> InnovationVariance:
        """A learner that begins with the stated R."""
        return InnovationVariance(observation.variance, self.options.memory, self.options.floor * observation.variance)

    def learn(self, learner: InnovationVariance, observation: Observation, dt_s: float) -> Observation:  # noqa: ARG002
        """The observation with R̂, after this reading's innovation."""
        expected = self.expected(observation)
        learner.learn(observation.value - expected.value, expected.variance)
        return self.judge(learner, observation)

    def judge(self, learner: InnovationVariance, observation: Observation) -> Observation:
        """The observation with R̂ unchanged."""
        return observation._replace(variance=learner.variance)
