"""Plain adaptive RLS before a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from ..noise.learner import Learner
from ..noise.rls import ForgettingSmoother
from .learning import LearningFilter
from .options import fraction, positive


@dataclass(frozen=True)
class RlsOptions:
    """`forgetting` λ of the parabola; `memory`: readings over which R is estimated."""

    forgetting: float = 0.9
    memory: int = 50

    def __post_init__(self) -> None:
        fraction(self, "forgetting")
        positive(self, "memory")


class RlsFilter(LearningFilter[RlsOptions]):
    """Plain adaptive RLS, for comparison (see `rls.ForgettingSmoother`). Source: C (1)-(7)."""

    kind = "rls"
    options_model = RlsOptions

    @classmethod
    def learner(cls, options: RlsOptions) -> Learner:
        """A smoother that begins with the stated R."""
        return ForgettingSmoother(options.forgetting, options.memory)
