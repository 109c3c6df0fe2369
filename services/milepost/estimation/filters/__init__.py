"""THE FILTER TABLE: one file for each kind of local filter that a train file may name, a row here or an entry point."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any

from ..kinds import Kinds
from .adaptive_kalman import AdaptiveKalmanFilter
from .base import LocalFilter
from .h_infinity import HInfinityFilter
from .kalman import KalmanFilter
from .pu_rls import PuRlsFilter
from .rls import RlsFilter
from .robust_kalman import RobustKalmanFilter

GROUP = "milepost.filters"


def _mistake(kind: type[LocalFilter[Any]]) -> str:
    """What is wrong with a kind of another distribution; empty where nothing is."""
    good = isinstance(kind.options_model, type) and is_dataclass(kind.options_model)
    return "" if good else "its `options_model` is not a dataclass"


FILTERS: Kinds[type[LocalFilter[Any]]] = Kinds(
    GROUP,
    LocalFilter,
    (KalmanFilter, AdaptiveKalmanFilter, RobustKalmanFilter, HInfinityFilter, RlsFilter, PuRlsFilter),
    _mistake,
)
