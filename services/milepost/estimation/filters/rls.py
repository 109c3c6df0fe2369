"""Plain adaptive RLS before a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from ..noise.rls import ForgettingSmoother
from ..observation import Observation
from .options import fraction, positive
from .prefilter import PreFilter, Smoother


@dataclass(frozen=True)
class RlsOptions:
    """`forgetting` λ of the parabola; `memory`: readings over which R is estimated."""

    forgetting: float = 0.9
    memory: int = 50

    def __post_init__(self) -> None:
        fraction(self, "forgetting")
        positive(self, "memory")


class RlsFilter(PreFilter[RlsOptions]):
    """Plain adaptive RLS, for comparison (see `rls.ForgettingSmoother`). Source: C (1)-(7)."""

    kind = "rls"
    options_model = RlsOptions

    def learner(self, observation: Observation) -> Smoother:
        """A smoother that begins with the stated R."""
        return ForgettingSmoother(self.options.forgetting, observation.variance, self.options.memory)
