"""An observation, its identity and its place in the timeline."""

from __future__ import annotations

from typing import Any, NamedTuple

# an observation that is stamped further ahead of now is refused
FUTURE_NS = 500_000_000
UNTIMELY = TOO_OLD, FROM_FUTURE = "too_old", "from_future"


class Identity(NamedTuple):
    """The identity of an observation: observations with the same identity count once, whatever their instance."""

    unit: str
    measured_at_ns: int
    component: int


class Place(NamedTuple):
    """The place of an observation in the timeline; `order` is its unit's row in the train file."""

    measured_at_ns: int
    order: int
    component: int


class Observation(NamedTuple):
    """One scalar observation z = h x + e, e ~ N(0, R): `row` is h over the timeline's states.

    Or a whole `reading`, which the kernel turns into rows at the belief at its place; `row` is then empty.
    """

    measured_at_ns: int
    order: int
    sequence: int
    instance: str
    component: int
    unit: str
    row: tuple[float, ...]
    value: float = 0.0
    variance: float = 0.0
    reading: Any = None

    @property
    def identity(self) -> Identity:
        """The unit, time and component, by which repetitions are found."""
        return Identity(self.unit, self.measured_at_ns, self.component)

    @property
    def place(self) -> Place:
        """The time, order and component, by which the timeline is sorted."""
        return Place(self.measured_at_ns, self.order, self.component)


def untimely(at_ns: int, boundary_ns: int, now_ns: int) -> str | None:
    """The reason for which something measured at `at_ns` is refused: before the boundary, or too far ahead of now."""
    if at_ns < boundary_ns:
        return TOO_OLD
    return FROM_FUTURE if at_ns > now_ns + FUTURE_NS else None


def rank(o: Observation) -> tuple[Any, ...]:
    """The sort key among observations with the same identity: the least one counts, whatever the order of arrival."""
    return (o.instance, o.sequence, o.row, o.value, o.variance, repr(o.reading))
