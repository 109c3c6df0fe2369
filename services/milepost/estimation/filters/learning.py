"""Filters that learn from readings before the belief takes them."""

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
    """The prediction of an observation: h x̂ and h P hᵀ."""

    value: float
    variance: float


class LearningFilter(LocalFilter[O], Generic[O, S]):
    """One learner S for each component of a reading, in the order of time.

    A learner learns only from a reading that is later than all before it and is not refused. From late, repeated or untimely
    readings nothing is learned: they get the values learned so far. Memory: one learner for each component.
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
        """Learn from an observation `dt_s` after the last (0 for the first); returns the observation for the belief."""

    @abstractmethod
    def judge(self, learner: S, observation: Observation) -> Observation:
        """The observation for the belief, without learning from it."""

    def prepare(self, observations: Sequence[Observation], now_ns: int) -> Sequence[Observation]:
        """A reading's observations with the learned values or variances."""
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
        the fused covariance predicted forward, the true covariance of x̂. Before the time of the feedback it is the
        fused belief predicted backwards, which is not divided by β, nor is the prior.
        """
        estimator, at = self.estimator, observation.measured_at_ns
        h = np.array(estimator.layout.lift(observation.unit, observation.row))
        base_ns, prior, belief = estimator.timeline.base_ns, self.setup.prior, estimator.belief_at(at)
        mean, covariance = belief or estimator.layout.prior(prior.mean, prior.std)
        if belief is not None and (base_ns is None or at >= base_ns) and estimator.share < 1.0:
            common = estimator.share * covariance[:N_COMMON, :N_COMMON]
            covariance = replace_common(mean, covariance, mean[:N_COMMON], common)[1]
        return Expected(float(h @ mean), max(float(h @ covariance @ h), 0.0))
