"""The interface of a fusion rule: what it takes, and what it makes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple, Protocol

from milepost.estimation.kept import Counters, Kept
from milepost.estimation.layout import Array
from milepost.estimation.observation import Observation

from .bank_state import Bank
from .hypotheses import Doubts
from .readings import Judge
from .verdicts import Reset, Verdict

NO_JUDGES: Mapping[str, Judge] = {}
NO_DOUBTS = Doubts()


class LocalBelief(NamedTuple):
    """A filter's mean and covariance at a time; `fed`: it contains feedback, and so has the same origin as the others."""

    at_ns: int
    mean: list[float]
    covariance: list[list[float]]
    fed: bool


class Fused(NamedTuple):
    """A fused mean and covariance, the last verdicts by unit, and the time of the first fused state.

    `bounds` (min, max) of position and speed over all hypotheses; None where the rule has none. `doubted`: the units of which
    one lies, and nothing tells which. `reset`: the last step by more than the state's own uncertainty. `bank`: the hypotheses
    that it was made from, where the rule has any.
    """

    mean: list[float]
    covariance: list[list[float]]
    verdicts: Mapping[str, Verdict]
    since_ns: int
    bounds: tuple[tuple[float, float], tuple[float, float]] | None = None
    doubted: tuple[str, ...] = ()
    reset: Reset | None = None
    bank: Bank | None = None

    @property
    def speed_mps(self) -> float:
        """The fused speed."""
        return self.mean[1]

    @property
    def variances(self) -> tuple[float, float, float]:
        """The variances of [s, v, a]."""
        P = self.covariance
        return P[0][0], P[1][1], P[2][2]


class FusionRule(Protocol):
    """The interface of a fusion rule. `take_...` return the reason for a refusal, None where an observation is accepted.

    `needs_shares`: whether the fused state depends on the shares. `live`: a state may lack what came late and waits for others.
    `kept`: all that its states depend on, for a replica that `resume`s from it; None where there is nothing to be handed over.
    """

    needs_shares: ClassVar[bool]
    names: list[str]
    counters: Counters

    def take_estimate(
        self, unit: str, belief: LocalBelief, observations: Sequence[Observation], now_ns: int
    ) -> list[str | None]: ...
    def take_fix(self, fix: Observation, now_ns: int) -> str | None: ...
    def start_from(self, at_ns: int, mean: Array, covariance: Array) -> None: ...
    def kept(self) -> Kept | None: ...
    def resume(self, kept: Kept) -> None: ...
    def state_at(self, at_ns: int, shares: Mapping[str, float], live: bool = False) -> Fused | None: ...
    def advance_to(self, now_ns: int) -> None: ...
