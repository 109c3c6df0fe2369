"""THE FILTER TABLE: one file for each kind of local filter that a train file may name, one row here."""

from __future__ import annotations

from typing import Any

from .adaptive_kalman import AdaptiveKalmanFilter
from .base import LocalFilter
from .h_infinity import HInfinityFilter
from .kalman import KalmanFilter
from .pu_rls import PuRlsFilter
from .rls import RlsFilter
from .robust_kalman import RobustKalmanFilter

FILTERS: dict[str, type[LocalFilter[Any]]] = {
    kind.kind: kind
    for kind in (KalmanFilter, AdaptiveKalmanFilter, RobustKalmanFilter, HInfinityFilter, RlsFilter, PuRlsFilter)
}
