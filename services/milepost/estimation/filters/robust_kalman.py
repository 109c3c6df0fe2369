"""The robust Kalman filter: time-varying noise with outliers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from ..noise.learner import Learner
from ..noise.noise_scale import NoiseModel, NoiseScale
from .learning import LearningFilter
from .options import fraction, positive


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


class RobustKalmanFilter(LearningFilter[RobustKalmanOptions]):
    """States, for each component of a reading, the Gaussian that stands for its likelihood (see `noise_scale.NoiseScale`)."""

    kind = "robust_kalman"
    options_model = RobustKalmanOptions

    @classmethod
    def learner(cls, options: RobustKalmanOptions) -> Learner:
        """The grid, of which only the range is known at first."""
        return NoiseScale(NoiseModel(**asdict(options)))
