"""The adaptive Kalman filter: R from the innovations."""

from __future__ import annotations

from dataclasses import dataclass

from ..noise.adaptive import InnovationVariance
from ..noise.learner import Learner
from .learning import LearningFilter
from .options import positive


@dataclass(frozen=True)
class AdaptiveKalmanOptions:
    """`memory`: readings over which R is estimated; `floor`: R̂ is at least this share of the stated R."""

    memory: int = 50
    floor: float = 0.25

    def __post_init__(self) -> None:
        positive(self, "memory", "floor")


class AdaptiveKalmanFilter(LearningFilter[AdaptiveKalmanOptions]):
    """States R̂ = mean(e² - h P hᵀ) for each component of a reading (see `adaptive.InnovationVariance`)."""

    kind = "adaptive_kalman"
    options_model = AdaptiveKalmanOptions

    @classmethod
    def learner(cls, options: AdaptiveKalmanOptions) -> Learner:
        """R̂, which begins with the stated R."""
        return InnovationVariance(options.memory, options.floor)
