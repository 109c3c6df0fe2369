"""Filters that learn from readings before the belief takes them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..gaussian import replace_common
from ..layout import N_COMMON
from ..noise.learner import Learned, Learner, Seen, learned, unlearned
from ..observation import Observation
from .base import FilterSetup, LocalFilter, O


class Expected(NamedTuple):
    """The prediction of an observation: h x̂ and h P hᵀ."""

    value: float
    variance: float


class LearningFilter(LocalFilter[O]):
    """One memory for each component of a reading, in the order of arrival, for this filter's own belief.

    It learns only from a reading that is later than all before it and is not refused. From late, repeated or untimely
    readings nothing is learned: they count by what was learned so far. The fuser learns by itself, with the same learner.
    """

    def __init__(self, setup: FilterSetup, options: O) -> None:
        super().__init__(setup, options)
        self._learner = self.learner(options)
        self._learned: dict[int, Learned] = {}

    @classmethod
    @abstractmethod
    def learner(cls, options: O) -> Learner:
        """How this kind learns."""

    def prepare(self, observations: Sequence[Observation], now_ns: int) -> Sequence[Observation]:
        """A reading's observations with the learned values or variances."""
        return [self._prepared(o, now_ns) for o in observations]

    def _prepared(self, observation: Observation, now_ns: int) -> Observation:
        at = observation.measured_at_ns
        if self.estimator.timeline.untimely(at, now_ns) is not None:
            return observation
        value, variance = np.array([observation.value]), np.array([observation.variance])
        seen, last = Seen(value, variance, value, variance), self._learned.get(observation.component)
        if self._learner.needs_belief:
            expected = self.expected(observation)
            seen = Seen(value, variance, value - expected.value, np.array([expected.variance]))
        if last is not None and at <= last.at_ns:
            judged = unlearned(self._learner, last, seen)
        else:
            judged, self._learned[observation.component] = learned(self._learner, last, at, seen)
        return observation._replace(value=float(judged.value[0]), variance=float(judged.variance[0]))

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
