"""Least-squares pre-filters before a Kalman filter: plain adaptive RLS and PU-RLS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..pu_rls import ErrorModel, SwarmTunedSmoother, Tuning
from ..rls import ForgettingSmoother
from ..timeline import Observation
from .base import O
from .learning import LearningFilter
from .options import fraction, positive


class Smoother(Protocol):
    """A pre-filter on one component of a reading."""

    @property
    def variance(self) -> float: ...
    def step(self, dt_s: float, value: float) -> tuple[float, float]: ...


class PreFilter(LearningFilter[O, Smoother]):
    """Passes on smoothed readings at R_eff; what comes late passes as it is, at the variance of a reading now.

    The belief has no part in it, so what is passed on does not depend on feedback.
    """

    def learn(self, learner: Smoother, observation: Observation, dt_s: float) -> Observation:
        """The smoothed reading."""
        value, variance = learner.step(dt_s, observation.value)
        return observation._replace(value=value, variance=variance)

    def judge(self, learner: Smoother, observation: Observation) -> Observation:
        """The reading as it is."""
        return observation._replace(variance=learner.variance)


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
        """It begins with the stated R."""
        return ForgettingSmoother(self.options.forgetting, observation.variance, self.options.memory)


@dataclass(frozen=True)
class PuRlsOptions:
    """`memory`: readings over which σ is estimated; `longest` λ; `degrees` ν; the swarm's bounds and seed (see `pu_rls`)."""

    memory: int = 25
    longest: float = 0.97
    degrees: float = 4.0
    particles: int = 6
    generations: int = 2
    window: int = 16
    every: int = 10
    seed: int = 1

    def __post_init__(self) -> None:
        positive(self, "memory", "degrees", "particles", "generations", "every")
        fraction(self, "longest")
        if not self.longest > 0.7:
            raise ValueError("longest: must be above 0.7")
        if not 4 <= self.window <= 200:
            raise ValueError("window: must lie between 4 and 200")


class PuRlsFilter(PreFilter[PuRlsOptions]):
    """PU-RLS (see `pu_rls.SwarmTunedSmoother`). Source: C (1)-(12)."""

    kind = "pu_rls"
    options_model = PuRlsOptions

    def learner(self, observation: Observation) -> Smoother:
        """It begins with the stated R."""
        o = self.options
        return SwarmTunedSmoother(
            observation.variance,
            o.memory,
            ErrorModel(o.degrees, o.longest),
            Tuning(o.particles, o.generations, o.window, o.every, o.seed),
        )
