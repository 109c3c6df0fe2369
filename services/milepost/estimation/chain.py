"""Observations in the order of the times at which they were true, and the belief after each, as far as it has been computed."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Protocol

from .observation import Observation, Place
from .time_units import S_PER_NS


class Kernel(Protocol):
    """The two steps that a chain runs; it knows nothing about the states."""

    def advance(self, state: Any, dt_s: float) -> Any: ...
    def take(self, state: Any, observation: Observation) -> Any: ...


class Chain:
    """`knots` are the observations, in order of their `keys`; the beliefs after the first `valid` of them are known.

    `base` is the belief before the first one: at `base_ns`, or where that is None, at the first one's time, whatever that is.
    """

    def __init__(self, kernel: Kernel, base: Any, base_ns: int | None = None, knots: tuple[Observation, ...] = ()) -> None:
        self.kernel = kernel
        self.base, self.base_ns = base, base_ns
        self.knots = list(knots)
        self.keys: list[Place] = [o.place for o in knots]
        self.states: list[Any] = [None] * len(knots)
        self.valid = 0

    def copy(self) -> Chain:
        """The same, apart from this one."""
        out = Chain(self.kernel, self.base, self.base_ns)
        out.knots, out.keys, out.states, out.valid = self.knots[:], self.keys[:], self.states[:], self.valid
        return out

    def behind(self, observation: Observation) -> int:
        """How many known beliefs an observation would make unknown; none where it is the first of all."""
        place = bisect_right(self.keys, observation.place)
        return max(0, self.valid - place) if place else 0

    def place(self, observation: Observation) -> int:
        """Insert an observation; returns how many beliefs are unknown since."""
        key = observation.place
        place = bisect_right(self.keys, key)
        lost = max(0, self.valid - place)
        self.valid -= lost
        self.keys.insert(place, key)
        self.knots.insert(place, observation)
        self.states.insert(place, None)
        return lost

    def count_until(self, at_ns: int) -> int:
        """How many knots are at a time or before."""
        # a tuple of a time alone sorts before all places at that time
        return bisect_left(self.keys, (at_ns + 1,))

    def replay(self, until: int) -> None:
        """Compute the beliefs after the first `until` knots."""
        place = self.valid
        if place >= until:
            return
        advance, take = self.kernel.advance, self.kernel.take
        if place:
            state, at = self.states[place - 1], self.keys[place - 1][0]
        else:
            state, at = self.base, self.base_ns if self.base_ns is not None else self.keys[0][0]
        while place < until:
            knot = self.knots[place]
            if knot.measured_at_ns > at:
                state = advance(state, (knot.measured_at_ns - at) * S_PER_NS)
                at = knot.measured_at_ns
            state = take(state, knot)
            self.states[place] = state
            place += 1
        self.valid = until

    def state_at(self, at_ns: int) -> Any | None:
        """The belief at a time, from all observations until then; None before the base. It adds no knot."""
        place = self.count_until(at_ns)
        if place:
            self.replay(place)
            state, from_ns = self.states[place - 1], self.keys[place - 1][0]
        elif self.base_ns is not None and at_ns >= self.base_ns:
            state, from_ns = self.base, self.base_ns
        else:
            return None
        return self.kernel.advance(state, (at_ns - from_ns) * S_PER_NS) if at_ns > from_ns else state

    def before(self, at_ns: int) -> tuple[Any, int | None, int]:
        """The belief after the last knot before a time, that knot's time, and how many knots are before; else the base's."""
        place = self.count_until(at_ns - 1)
        if not place:
            return self.base, self.base_ns, 0
        self.replay(place)
        return self.states[place - 1], self.keys[place - 1][0], place

    def fold(self, at_ns: int) -> None:
        """Make the belief after the last knot before a time the base."""
        base, base_ns, place = self.before(at_ns)
        self.drop(place)
        self.base, self.base_ns = base, base_ns

    def rebase(self, at_ns: int, state: Any) -> None:
        """Make `state` the base, at a time: it contains all observations until then; later ones are computed on it."""
        self.drop(self.count_until(at_ns))
        self.base, self.base_ns = state, at_ns
        self.states = [None] * len(self.knots)
        self.valid = 0

    def drop(self, place: int) -> None:
        """Forget the first knots."""
        del self.keys[:place], self.knots[:place], self.states[:place]
        self.valid = max(0, self.valid - place)
