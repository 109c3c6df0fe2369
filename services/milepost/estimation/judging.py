"""Readings are linearised and judged at their place in time, by judges whose memory rewinds with the belief."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from .layout import Array, Layout
from .observation import Observation

LinearRow = tuple[tuple[float, ...], float, float]


class Verdict(NamedTuple):
    """A judge's last verdict on a unit, and the judge's memory.

    `heard_ns`, `counted_ns`: the times of the last reading, and of the last one that counted. `gating`: the reason for which
    no reading counts at present. `refused`: the reason for which the last reading did not count. `memory` is immutable.
    """

    memory: Any
    heard_ns: int | None = None
    counted_ns: int | None = None
    gating: str | None = None
    refused: str | None = None


class Judge(Protocol):
    """Turns a unit's reading into rows (h, z, R) over [s, v, a, own private], from the belief over these."""

    def start(self) -> Any:
        """The memory before the first reading."""

    def restart(self) -> Any:
        """The memory after a restart on a running train."""

    def judge(
        self, memory: Any, reading: Any, mean: Array, covariance: Array
    ) -> tuple[Sequence[LinearRow], Any, str | None, str | None]:
        """The rows, the memory after the reading, the reason for gating, and the reason for which the reading is refused."""


class Judged(NamedTuple):
    """A belief in the inner kernel's form and every judge's last verdict.

    `since_ns`: the time of the first observation that counted, where the prior sits; None before it.
    """

    belief: Any
    verdicts: Mapping[str, Verdict]
    since_ns: int | None


class JudgingKernel:
    """The two steps over a layout, and a third one that takes a whole reading.

    A reading's rows and its judge's memory depend on the belief at the reading's time and on the readings before it, not on
    the order of arrival. So the result is a function of the set of readings alone, and it is the centralised filter's: each
    reading is linearised at the belief from all readings before it.
    """

    def __init__(self, inner: Any, layout: Layout, judges: Mapping[str, Judge]) -> None:
        self._inner, self._layout, self._judges = inner, layout, judges
        own = {unit: list(layout.indices.get(unit, (0, 1, 2))) for unit in judges}
        self._places = {unit: (np.array(places), np.ix_(places, places)) for unit, places in own.items()}

    def prior(self, mean: Array, covariance: Array) -> Judged:
        """The prior before the first observation."""
        return Judged(self._inner.pack(mean, covariance), {u: Verdict(j.start()) for u, j in self._judges.items()}, None)

    def pack(self, mean: Array, covariance: Array) -> Judged:
        """A belief on a running train; the judges restart with an empty memory."""
        verdicts = {unit: Verdict(judge.restart()) for unit, judge in self._judges.items()}
        return Judged(self._inner.pack(mean, covariance), verdicts, 0)

    def unpack(self, state: Judged) -> tuple[Array, Array]:
        """The mean (n) and covariance (n, n) of a belief."""
        mean, covariance = self._inner.unpack(state.belief)
        return mean, covariance

    def lists(self, state: Judged) -> tuple[list[float], list[list[float]]]:
        """The mean (n) and covariance (n, n) of a belief as lists, for messages."""
        mean, covariance = self._inner.lists(state.belief)
        return mean, covariance

    def advance(self, state: Judged, dt_s: float) -> Judged:
        """The belief `dt_s` seconds later."""
        belief, verdicts, since_ns = state
        return state if since_ns is None else Judged(self._inner.advance(belief, dt_s), verdicts, since_ns)

    def take(self, state: Judged, observation: Observation) -> Judged:
        """The belief after one observation, or after a whole reading with its judge's verdict."""
        belief, verdicts, since_ns = state
        at_ns = observation.measured_at_ns
        if observation.reading is None:
            return Judged(self._inner.take(belief, observation), verdicts, at_ns if since_ns is None else since_ns)
        unit = observation.unit
        before = verdicts[unit]
        mean, covariance = self._inner.unpack(belief)
        own, block = self._places[unit]
        rows, memory, gating, refused = self._judges[unit].judge(
            before.memory, observation.reading, mean[own], covariance[block]
        )
        for row, value, variance in rows:
            belief = self._inner.update(belief, self._layout.lift(unit, row), value, variance)
        counted_ns = at_ns if rows else before.counted_ns
        since_ns = at_ns if rows and since_ns is None else since_ns
        return Judged(belief, {**verdicts, unit: Verdict(memory, at_ns, counted_ns, gating, refused)}, since_ns)
