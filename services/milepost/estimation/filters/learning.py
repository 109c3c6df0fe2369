"""Filters that learn from their readings before the belief takes them: what may be learned from, and what is expected."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from milepost.estimation.time_units import S_PER_NS

from ..gaussian import replace_common
from ..layout import N_COMMON
from ..observation import Observation
from .base import FilterSetup, LocalFilter, O

S = TypeVar("S")


class Expected(NamedTuple):
    """What the belief expects of an observation: h x̂ and h P hᵀ."""

    value: float
    variance: float


class LearningFilter(LocalFilter[O], Generic[O, S]):
    """One learner S for each component of a reading, in the order of time.

    A reading learns only if it is later than every one before it and would not be refused: what comes late or twice, or
    is stamped wildly, is judged by what is known and teaches nothing. Memory: one learner for each component.
    """

    passes_readings = False

    def __init__(self, setup: FilterSetup, options: O) -> None:
        super().__init__(setup, options)
        self._learners: dict[int, tuple[int, S]] = {}

    @abstractmethod
    def learner(self, observation: Observation) -> S:
        """A new learner, from the first observation of a component."""

    @abstractmethod
    def learn(self, learner: S, observation: Observation, dt_s: float) -> Observation:
        """Learn from an observation `dt_s` after the last (0 for the first); returns what the belief takes."""

    @abstractmethod
    def judge(self, learner: S, observation: Observation) -> Observation:
        """What the belief takes of an observation that teaches nothing."""

    def prepare(self, observations: Sequence[Observation], now_ns: int) -> Sequence[Observation]:
        """A reading's observations with what was learned."""
        return [self._prepared(o, now_ns) for o in observations]

    def _prepared(self, observation: Observation, now_ns: int) -> Observation:
        at = observation.measured_at_ns
        if self.estimator.timeline.untimely(at, now_ns) is not None:
            return observation
        last = self._learners.get(observation.component)
        if last is not None and at <= last[0]:
            return self.judge(last[1], observation)
        learner = self.learner(observation) if last is None else last[1]
        self._learners[observation.component] = (at, learner)
        return self.learn(learner, observation, 0.0 if last is None else (at - last[0]) * S_PER_NS)

    def expected(self, observation: Observation) -> Expected:
        """h x̂ and c, the variance of h (x - x̂), at an observation's time.

        A belief that takes feedback is P_g/β and grows with Q/β; its common block times β, the private states following, is
        the fused covariance carried forward, which is how far off x̂ really is. Of a time before the feedback it is the
        fused belief carried back, which is not divided by β; and nor is the prior.
        """
        estimator, at = self.estimator, observation.measured_at_ns
        h = np.array(estimator.layout.lift(observation.unit, observation.row))
        base_ns, prior, belief = estimator.timeline.base_ns, self.setup.prior, estimator.belief_at(at)
        mean, covariance = belief or estimator.layout.prior(prior.mean, prior.std)
        if belief is not None and (base_ns is None or at >= base_ns) and estimator.share < 1.0:
            common = estimator.share * covariance[:N_COMMON, :N_COMMON]
            covariance = replace_common(mean, covariance, mean[:N_COMMON], common)[1]
        return Expected(float(h @ mean), max(float(h @ covariance @ h), 0.0))
