"""The robust Kalman filter: time-varying noise with outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..layout import Array
from ..noise.noise_scale import NoiseModel, NoiseScale
from ..observation import Observation
from .learning import LearningFilter
from .options import fraction, positive

# the least predicted variance, as a share of the stated R: a smaller one makes no difference
LEAST_EXPECTED = 1e-9


@dataclass(frozen=True)
class RobustKalmanOptions:
    """The noise: `lowest`, `highest` σ over the stated one, on `levels` levels; `time_constant_s`, `spread` of ln σ.

    `outlier_share` of the readings have `outlier_ratio` times σ.
    """

    lowest: float = 0.2
    highest: float = 20.0
    levels: int = 24
    time_constant_s: float = 20.0
    spread: float = 0.6
    outlier_share: float = 0.05
    outlier_ratio: float = 10.0

    def __post_init__(self) -> None:
        positive(self, "lowest", "highest", "time_constant_s", "spread")
        fraction(self, "outlier_share")
        if not 1.0 < self.outlier_ratio < math.inf:
            raise ValueError("outlier_ratio: must be above 1 and finite")
        if self.highest <= self.lowest:
            raise ValueError("highest: must be above lowest")
        if not 4 <= self.levels <= 200:
            raise ValueError("levels: must lie between 4 and 200")


class RobustKalmanFilter(LearningFilter[RobustKalmanOptions, NoiseScale]):
    """States, for each component of a reading, the Gaussian that stands for its likelihood (see `noise_scale.NoiseScale`)."""

    kind = "robust_kalman"
    options_model = RobustKalmanOptions

    def learner(self, observation: Observation) -> NoiseScale:
        """A learner that knows only the range of σ."""
        o, std = self.options, math.sqrt(observation.variance)
        return NoiseScale(
            NoiseModel(o.lowest * std, o.highest * std, o.levels, o.time_constant_s, o.spread, o.outlier_share, o.outlier_ratio)
        )

    def learn(self, learner: NoiseScale, observation: Observation, dt_s: float) -> Observation:
        """The site of this reading, and σ after it."""
        learner.advance(dt_s)
        taken, learner.weights = self._site(learner, observation)
        return taken

    def judge(self, learner: NoiseScale, observation: Observation) -> Observation:
        """The site of this reading, with σ unchanged."""
        return self._site(learner, observation)[0]

    def _site(self, learner: NoiseScale, observation: Observation) -> tuple[Observation, Array]:
        value, variance = self.expected(observation)
        site, weights = learner.site(observation.value - value, max(variance, LEAST_EXPECTED * observation.variance))
        return observation._replace(value=value + site.value, variance=site.variance), weights
