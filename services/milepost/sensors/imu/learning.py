"""An inertial unit that learns its error while GNSS is trustworthy, and corrects with what it learned in an outage."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any

from pydantic import BaseModel, Field

from milepost.estimation.notice import Notice
from milepost.recordings.options import STRICT

from ..observed import Belief, Observed
from .learned_error import InertialErrorModel, LearnedError, equivalent_white_variance

Observe = Callable[[Any, Belief | None], Sequence[Observed]]
Positive = Annotated[float, Field(gt=0.0)]
LEAST_VARIANCE = 1e-12


class LearnOptions(BaseModel):
    """The conditions and parameters of the learning.

    `trusted_position_std_m`, `trusted_speed_std_mps`: beyond either it is an outage. `window_s` of a sample; `memory_s` of the
    forgetting, null: as long as the bias allows (see `InertialErrorModel`). `longest_outage_s`: up to which an outage's growing
    error is stated.
    """

    model_config = STRICT

    trusted_position_std_m: Positive = 10.0
    trusted_speed_std_mps: Positive = 2.0
    window_s: Positive = 20.0
    memory_s: Positive | None = None
    longest_outage_s: Positive = 300.0


class LearningUnit:
    """Subtracts the learned error ε̂ from each reading, z - ε̂, and adds the equivalent white variance of Var ε̂ to R.

    It stands in for a bias in the state. Its only time is that of the readings. Source: C 2.1 (13).
    """

    def __init__(self, observe: Observe, options: LearnOptions, model: InertialErrorModel) -> None:
        self._observe, self._options = observe, options
        self._learned = LearnedError(model)
        self._origin_ns: int | None = None
        self._trusted = True
        self._notices: list[Notice] = []

    @property
    def memory(self) -> Any:
        """The learned error, the time at which it begins, and whether the fused state was good enough."""
        return self._learned.memory, self._origin_ns, self._trusted

    @memory.setter
    def memory(self, memory: Any) -> None:
        self._learned.memory, self._origin_ns, self._trusted = memory

    def restarted(self) -> None:
        """Begin to learn again, from the data sheet's variances."""

    @property
    def gating(self) -> str | None:
        """None: every reading counts."""
        return None

    @property
    def refused(self) -> str | None:
        """None: every reading counts."""
        return None

    def notices(self) -> list[Notice]:
        """The notices of the beginning and the end of learning."""
        out, self._notices = self._notices, []
        return out

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """The reading's observation, corrected by the learned error."""
        seen = self._observe(reading, belief)
        if belief is None or not seen:
            return seen
        if self._origin_ns is None:
            self._origin_ns = reading.measured_at_ns
        t_s, dt_s = (reading.measured_at_ns - self._origin_ns) * 1e-9, reading.mean_over_s
        ((row, z, R),) = seen
        mean, covariance = belief
        P_ss, P_vv = float(covariance[0, 0]), max(float(covariance[1, 1]), LEAST_VARIANCE)
        if self._trust(P_ss, P_vv, t_s):
            self._learned.learn(t_s, dt_s, z, float(mean[1]), P_vv, float(mean[2]))
        else:
            self._learned.pause()
        error, variance = self._learned.correction(t_s)
        R += equivalent_white_variance(variance, P_ss, P_vv, dt_s, self._options.longest_outage_s)
        return (Observed(row, z - error, R),)

    def _trust(self, position_variance: float, speed_variance: float, t_s: float) -> bool:
        options = self._options
        trusted = position_variance < options.trusted_position_std_m**2 and speed_variance < options.trusted_speed_std_mps**2
        if trusted != self._trusted:
            error, variance = self._learned.correction(t_s)
            text = f"learned error {error:+.4f} m/s² ± {math.sqrt(variance):.4f}"
            self._notices.append(
                Notice("info", "error_learning", f"the fused state is good again: {text}")
                if trusted
                else Notice(
                    "warning", "error_learned", f"the fused state is not good enough to learn from: {text} from here on"
                )
            )
            self._trusted = trusted
        return trusted
