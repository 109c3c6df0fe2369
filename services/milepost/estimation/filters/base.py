"""The interface of a local filter.

A kind of filter decides how the variance of a reading's observations is learned, whether they are pre-filtered, and how its
own belief takes them. The fuser learns and pre-filters by itself, in each of its hypotheses; the belief does not reach it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from ..estimator import Estimator, Prior, kernel_for
from ..layout import Layout
from ..noise.learner import Learner
from ..notice import Notice
from ..observation import Observation


@dataclass(frozen=True)
class FilterSetup:
    """The setup of a local filter: states, q in m²/s⁵, prior, horizon and share β."""

    layout: Layout
    jerk_psd: float
    prior: Prior
    horizon_ns: int
    share: float = 1.0


O = TypeVar("O")  # noqa: E741


class LocalFilter(Generic[O]):
    """One kind of local filter.

    `options_model` is a frozen dataclass of plain values whose `__post_init__` raises ValueError("field: what is wrong").
    """

    kind: ClassVar[str]
    options_model: ClassVar[type[Any]]

    def __init__(self, setup: FilterSetup, options: O) -> None:
        self.setup = setup
        self.options = options
        self.estimator = Estimator(
            setup.layout, setup.jerk_psd, setup.prior, setup.horizon_ns, setup.share, kernels=self.kernel
        )

    @classmethod
    def learner(cls, options: O) -> Learner | None:  # noqa: ARG003
        """How it learns the noise of readings, or smooths them; None where it takes them as they are."""
        return None

    def kernel(self, layout: Layout, jerk_psd: float) -> Any:
        """The mathematics of its belief."""
        return kernel_for(layout, jerk_psd)

    def prepare(self, observations: Sequence[Observation], now_ns: int) -> Sequence[Observation]:  # noqa: ARG002
        """A reading's observations as this kind passes them on: z or R may change, the identity does not."""
        return observations

    def notices(self) -> list[Notice]:
        """The notices since the last call."""
        return []

    def take(
        self, observations: Sequence[Observation], now_ns: int, known: Sequence[Observation] = ()
    ) -> tuple[list[Observation], list[str]]:
        """Take a reading's observations into the belief; returns those for the fuser, and the reasons for refusals.

        `known` observations are of no reading: they are taken unchanged, and no noise is learned from them. An observation
        older than the feedback in the belief is `absorbed`: the belief cannot use it, the fuser can.
        """
        counted, refused = [], []
        for observation in (*self.prepare(observations, now_ns), *known):
            reason = self.estimator.insert(observation, now_ns)
            if reason is None or reason == "absorbed":
                counted.append(observation)
            else:
                refused.append(reason)
        return counted, refused
