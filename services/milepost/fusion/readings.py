"""A reading as rows of every hypothesis, linearised at each hypothesis's own belief."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from milepost.estimation.layout import PLACES_OF_COMMON, Array, Layout
from milepost.estimation.noise.learner import Learner, Seen, learned
from milepost.estimation.observation import Observation

from .evidence import Flags
from .stack import Stack
from .verdicts import Verdict

# what readings measure, one field of each kind
MEASURED = ("longitude_deg", "specific_force_mps2", "speed_mps")

LinearRow = tuple[tuple[float, ...], float, float]


class Linear(NamedTuple):
    """z = h x + e, e ~ N(0, R): h (n), z, R for all hypotheses alike, or h (H, n), z (H), R (H) for each.

    `present` (H): which hypotheses have the row; None: all.
    """

    h: Array
    z: Any
    R: Any
    present: Flags | None = None


class StackedRow(Protocol):
    """h (H, k) or (k), z, R and who has the row, over the k states of a unit."""

    @property
    def value(self) -> Any: ...
    def __iter__(self) -> Iterator[Any]: ...


class Judge(Protocol):
    """Turns a unit's reading into rows (h, z, R) over [s, v, a, own private], from the belief over these.

    `pure`: the rows depend on the reading and the belief alone, so that each hypothesis has its own; otherwise the judge
    remembers, judges once, at the leading belief, and its rows are those of every hypothesis. `learner`: how z and R of the
    rows are learned, None where they count as stated.
    """

    pure: bool
    learner: Learner | None

    def start(self) -> Any:
        """The memory before the first reading."""

    def restart(self) -> Any:
        """The memory after a restart on a running train."""

    def judge(
        self, memory: Any, reading: Any, mean: Array, covariance: Array
    ) -> tuple[Sequence[LinearRow], Any, str | None, str | None]:
        """The rows, the memory after the reading, the reason for gating, and the reason for which the reading is refused."""

    def each(self, reading: Any, means: Array, covariances: Array) -> Sequence[StackedRow] | None:
        """A pure judge's rows at each of H beliefs, means (H, k), covariances (H, k, k).

        None where the reading is not usable; no row where it tells nothing.
        """


class Readings:
    """A train's readings as rows over all states. `judges`: by unit."""

    def __init__(self, layout: Layout, judges: Mapping[str, Judge]) -> None:
        self._layout, self._judges = layout, judges
        self.learners = {unit: judge.learner for unit, judge in judges.items() if judge.learner is not None}
        self._stack = Stack()
        own = {unit: np.array(layout.indices.get(unit, PLACES_OF_COMMON)) for unit in judges}
        # the places in x, and in P row by row
        self._places = {unit: (places, (layout.dimension * places[:, None] + places).ravel()) for unit, places in own.items()}

    def learned(
        self, unit: str, component: int, row: Linear, verdict: Verdict, x: Array, P: Array, at_ns: int
    ) -> tuple[Linear, Verdict]:
        """A row as each hypothesis learned to take it, and the verdict with what it learned.

        What a hypothesis learns follows from what it believes, so that nothing is in it that it never heard.
        """
        learner, noise, (h, z, R, present) = self.learners[unit], verdict.noise, row
        _, c, nu = self._stack.innovations(x, P, h, z, 0.0) if learner.needs_belief else (None, 0.0, z)
        seen = Seen(*(np.atleast_1d(np.asarray(number, dtype=float)) for number in (z, R, nu, np.maximum(c, 0.0))))
        last = noise[component] if component < len(noise) else None
        judged, after = learned(learner, last, at_ns, seen, None if present is None else ~present)
        verdict = verdict._replace(noise=(*noise[:component], after, *noise[component + 1 :]))
        return Linear(h, judged.value, np.broadcast_to(judged.variance, len(x)), present), verdict

    def rows(
        self, memory: Any, observation: Observation, x: Array, P: Array, leader: int
    ) -> tuple[list[Linear], Any, str | None, str | None]:
        """A reading's rows for the hypotheses x (H, n), P (H, n, n), and what the judge says of it at the leading one."""
        unit, reading = observation.unit, observation.reading
        judge, (own, pairs) = self._judges[unit], self._places[unit]
        k = len(own)
        if not judge.pure:
            mean, covariance = x[leader].take(own), P[leader].take(pairs).reshape(k, k)
            rows, memory, gating, refused = judge.judge(memory, reading, mean, covariance)
            return [Linear(np.array(self._layout.lift(unit, h)), z, R) for h, z, R in rows], memory, gating, refused
        means, covariances = x.take(own, axis=1), P.reshape(len(P), -1).take(pairs, axis=1).reshape(-1, k, k)
        each = judge.each(reading, means, covariances)
        if each is None:
            return [], memory, None, "unusable"
        out = []
        for h, z, R, present in each:
            full = np.zeros((*h.shape[:-1], self._layout.dimension))
            full[..., own] = h
            out.append(Linear(full, z, R, present))
        return out, memory, None, None


def said_by(observation: Observation) -> Any:
    """What a unit measured, to be compared with what it said before; None where it only states a bound."""
    reading = observation.reading
    if reading is None:
        return observation.value
    fields = reading.__dict__
    return next((fields[name] for name in MEASURED if fields.get(name) is not None), None)
