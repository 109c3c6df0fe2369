"""THE FILTER TABLE: the kinds of local filter that a train file may name.

A kind decides how a reading becomes observations: its variance, whether it is pre-filtered, where it is linearised. Its
belief is its own; only its observations reach the fused result.
"""

from __future__ import annotations

from collections.abc import Sequence

from .estimator import Estimator
from .timeline import Observation


class KalmanFilter:
    """The ordinary Kalman filter (A (3)-(7)): takes observations as they come."""

    def __init__(self, estimator: Estimator) -> None:
        self.estimator = estimator

    def take(self, observations: Sequence[Observation], now_ns: int) -> tuple[list[Observation], list[str]]:
        """Take a reading's observations into the belief; returns those that the fuser shall count, and why others do not.

        An observation older than the feedback in the belief is `absorbed`: the belief cannot use it, the fuser can.
        """
        counted, refused = [], []
        for observation in observations:
            reason = self.estimator.insert(observation, now_ns)
            if reason is None or reason == "absorbed":
                counted.append(observation)
            else:
                refused.append(reason)
        return counted, refused


FILTERS: dict[str, type[KalmanFilter]] = {"kalman": KalmanFilter}
