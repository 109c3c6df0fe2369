"""PU-RLS before a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from ..noise.learner import Learner
from ..noise.pu_rls import ForgettingModel, SwarmTunedSmoother, Tuning
from .learning import LearningFilter
from .options import at_most, fraction, positive


@dataclass(frozen=True)
class PuRlsOptions:
    """`memory`: readings over which σ is estimated; `longest` λ; `degrees` ν; the swarm's bounds and seed (see `pu_rls`)."""

    memory: int = 15
    longest: float = 0.93
    degrees: float = 4.0
    particles: int = 6
    generations: int = 2
    window: int = 16
    every: int = 10
    seed: int = 1

    def __post_init__(self) -> None:
        positive(self, "memory", "degrees", "particles", "generations", "every")
        at_most(self, particles=100, generations=100)
        if self.seed < 0:
            raise ValueError("seed: must not be below 0")
        fraction(self, "longest")
        if not self.longest > 0.7:
            raise ValueError("longest: must be above 0.7")
        if not 4 <= self.window <= 200:
            raise ValueError("window: must lie between 4 and 200")


class PuRlsFilter(LearningFilter[PuRlsOptions]):
    """PU-RLS (see `pu_rls.SwarmTunedSmoother`). Source: C (1)-(12)."""

    kind = "pu_rls"
    options_model = PuRlsOptions

    @classmethod
    def learner(cls, options: PuRlsOptions) -> Learner:
        """A smoother that begins with the stated R."""
        o = options
        return SwarmTunedSmoother(
            o.memory, ForgettingModel(o.degrees, o.longest), Tuning(o.particles, o.generations, o.window, o.every, o.seed)
        )
