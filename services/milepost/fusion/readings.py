"""A reading as rows of every hypothesis, linearised at each hypothesis's own belief."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import PLACES_OF_COMMON, Array, Layout
from milepost.estimation.noise.learner import Learner, Seen, learned
from milepost.estimation.observation import Observation
from milepost.estimation.stack import Linear, Stack

from .verdicts import Verdict

# most rows are the same again and again
KEPT_ROWS = 256
# what readings measure, one field of each kind
MEASURED = ("longitude_deg", "specific_force_mps2", "speed_mps")

LinearRow = tuple[tuple[float, ...], float, float]


class StackedRow(Protocol):
    """h (k, H), or k numbers for all beliefs, z, R and who has the row, over the k states of a unit."""

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

    def each(self, reading: Any, beliefs: Beliefs) -> Sequence[StackedRow] | None:
        """A pure judge's rows at each of H beliefs.

        None where the reading is not usable; no row where it tells nothing.
        """


class Readings:
    """A train's readings as rows over all states. `judges`: by unit."""

    def __init__(self, layout: Layout, judges: Mapping[str, Judge]) -> None:
        self._judges = judges
        self._row = lru_cache(KEPT_ROWS)(lambda unit, h: dense(layout.lift(unit, h)))
        self.learners = {unit: judge.learner for unit, judge in judges.items() if judge.learner is not None}
        self._stack = Stack()
        places = {unit: layout.indices.get(unit, PLACES_OF_COMMON) for unit in judges}
        self._places = {unit: (own, np.array(own)) for unit, own in places.items()}

    def learned(
        self, unit: str, component: int, row: Linear, verdict: Verdict, beliefs: Array, at_ns: int
    ) -> tuple[Linear, Verdict]:
        """A row as each hypothesis learned to take it, and the verdict with what it learned.

        What a hypothesis learns follows from what it believes, so that nothing is in it that it never heard.
        """
        learner, noise, z, R, present = self.learners[unit], verdict.noise, row.z, row.R, row.present
        nu: Any = z
        c: Any = 0.0
        if learner.needs_belief:
            _, c, _, nu = self._stack.innovations(beliefs, row._replace(R=0.0))
        seen = Seen(*(np.atleast_1d(np.asarray(number, dtype=float)) for number in (z, R, nu, np.maximum(c, 0.0))))
        last = noise[component] if component < len(noise) else None
        judged, after = learned(learner, last, at_ns, seen, None if present is None else ~present)
        verdict = verdict._replace(noise=(*noise[:component], after, *noise[component + 1 :]))
        return row._replace(z=judged.value, R=np.broadcast_to(judged.variance, beliefs.shape[2])), verdict

    def rows(
        self, memory: Any, observation: Observation, beliefs: Array, leader: int
    ) -> tuple[list[Linear], Any, str | None, str | None]:
        """A reading's rows for all hypotheses, and what the judge says of it at the leading one."""
        unit, reading = observation.unit, observation.reading
        judge, (places, own) = self._judges[unit], self._places[unit]
        seen = Beliefs(beliefs, places)
        if not judge.pure:
            rows, memory, gating, refused = judge.judge(memory, reading, *seen.of(leader))
            return [Linear(self._row(unit, h), z, R) for h, z, R in rows], memory, gating, refused
        each = judge.each(reading, seen)
        if each is None:
            return [], memory, None, "unusable"
        out = []
        for h, z, R, present in each:
            alike = isinstance(h, tuple)
            out.append(Linear(self._row(unit, h), z, R, present) if alike else Linear(h, z, R, present, own))
        return out, memory, None, None


@lru_cache(KEPT_ROWS)
def dense(h: tuple[float, ...]) -> Array:
    """A row h (n) of all hypotheses, as `Stack` takes it."""
    return np.array((*h, 0.0))


def said_by(observation: Observation) -> Any:
    """What a unit measured, to be compared with what it said before; None where it only states a bound."""
    reading = observation.reading
    if reading is None:
        return observation.value
    fields = reading.__dict__
    for name in MEASURED:
        said = fields.get(name)
        if said is not None:
            return said
    return None
