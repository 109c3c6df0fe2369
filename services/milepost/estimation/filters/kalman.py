"""The ordinary Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from .base import LocalFilter


@dataclass(frozen=True)
class KalmanOptions:
    """No options."""


class KalmanFilter(LocalFilter[KalmanOptions]):
    """Takes observations unchanged, with their stated variance. Source: A (3)-(7)."""

    kind = "kalman"
    options_model = KalmanOptions
