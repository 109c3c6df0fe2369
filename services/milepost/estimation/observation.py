"""An observation: what it says, what makes it the same as another one, and where it stands in time."""

from __future__ import annotations

from typing import Any, NamedTuple

# what is stamped further ahead of now is refused
FUTURE_NS = 500_000_000


class Identity(NamedTuple):
    """What makes two observations the same one, whoever repeats it and under whatever instance."""

    unit: str
    measured_at_ns: int
    component: int


class Place(NamedTuple):
    """Where an observation stands in the order of the timeline: `order` is its unit's row in the train file."""

    measured_at_ns: int
    order: int
    component: int


class Observation(NamedTuple):
    """One scalar observation z = h x + e, e ~ N(0, R): `row` is h over the timeline's states.

    Or a whole `reading`, which the kernel turns into rows where it stands, from the belief there; `row` is then empty.
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
        """What makes it the same as another one."""
        return Identity(self.unit, self.measured_at_ns, self.component)

    @property
    def place(self) -> Place:
        """Where it stands."""
        return Place(self.measured_at_ns, self.order, self.component)


def untimely(at_ns: int, boundary_ns: int, now_ns: int) -> str | None:
    """The reason for which something measured at `at_ns` is refused: before the boundary, or too far ahead of now."""
    if at_ns < boundary_ns:
        return "too_old"
    return "from_future" if at_ns > now_ns + FUTURE_NS else None


def rank(o: Observation) -> tuple[Any, ...]:
    """Decides between observations of the same moment, so that the order of arrival does not."""
    return (o.instance, o.sequence, o.row, o.value, o.variance, repr(o.reading))
