"""The ordinary Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from .base import LocalFilter


@dataclass(frozen=True)
class KalmanOptions:
    """It has none."""


class KalmanFilter(LocalFilter[KalmanOptions]):
    """Takes observations as they come, at the variance that they state. Source: A (3)-(7)."""

    kind = "kalman"
    options_model = KalmanOptions
