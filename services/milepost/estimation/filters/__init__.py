"""THE FILTER TABLE: one file for each kind of local filter that a train file may name, one row here."""

from __future__ import annotations

from typing import Any

from .base import LocalFilter
from .kalman import KalmanFilter

FILTERS: dict[str, type[LocalFilter[Any]]] = {kind.kind: kind for kind in (KalmanFilter,)}
