"""A timeline of observations, in the order of the times at which they were true.

Every observation is a knot; the belief after each knot is kept as a checkpoint. A late observation is inserted at its
place, and the beliefs after it are computed again when they are needed. Because only observations are knots, the result
is a function of the set of observations alone: the same bits for any order of arrival.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Protocol

from .kept import Counters, Kept
from .late import AT_ONCE, Late
from .observation import Identity, Observation, Place, rank, untimely
from .time_units import S_PER_NS

# deleting from the front of a list costs its length, so it is done for many knots at once
PRUNE_AT_LEAST = 256
FORGET_AT_LEAST = 2048


class Kernel(Protocol):
    """The two steps that a timeline runs; it knows nothing about the states."""

    def advance(self, state: Any, dt_s: float) -> Any: ...
    def take(self, state: Any, observation: Observation) -> Any: ...


class Timeline:
    """Observations over a sliding horizon, and the belief at any time in it.

    `prior` is the kernel's state before the earliest observation, and moves back if an earlier one arrives; after
    `rebase` the base is fixed at a time instead. The settled boundary is `now` - `horizon_ns`, `now` being the largest
    time so far: older observations are refused, and states before it can no longer change. `state_at` has all observations;
    `live_at` may still lack some that came late (see `late`).
    """

    def __init__(self, kernel: Kernel, prior: Any, horizon_ns: int) -> None:
        self.kernel = kernel
        self.horizon_ns = horizon_ns
        self.counters = Counters()
        self._base = prior
        self._base_ns: int | None = None
        self._rebased = False
        self._keys: list[Place] = []
        self._knots: list[Observation] = []
        self._states: list[Any] = []
        self._valid = 0
        self._seen: set[Identity] = set()
        self._boundary_ns = 0
        self._forget_at = FORGET_AT_LEAST
        self._late = Late()

    @property
    def base_ns(self) -> int | None:
        """The time at which the base is fixed; None while the prior still moves with the earliest observation."""
        return self._base_ns

    @property
    def boundary_ns(self) -> int:
        """The settled boundary: states before this time no longer change."""
        return self._boundary_ns

    @property
    def earliest_ns(self) -> int | None:
        """The time of the earliest observation, or of the base where it is fixed."""
        if self._base_ns is not None:
            return self._base_ns
        return self._keys[0][0] if self._keys else None

    @property
    def latest_ns(self) -> int | None:
        """The time of the latest observation, or of the base where there is none after it."""
        return self._keys[-1][0] if self._keys else self._base_ns

    def insert(self, observation: Observation, now_ns: int) -> str | None:
        """Insert an observation at its place. Returns the reason if it is refused, `absorbed` if the base covers its time.

        Of several with the same identity the least by instance, sequence and content stays, whichever came first.
        """
        at = observation.measured_at_ns
        self._move_boundary(now_ns)
        reason = untimely(at, self._boundary_ns, now_ns)
        if reason is not None:
            return self._refuse(reason)
        identity = observation.identity
        if identity in self._seen:
            self._keep_the_least(observation)
            return self._refuse("duplicate")
        self._seen.add(identity)
        if self._rebased and self._base_ns is not None and at <= self._base_ns:
            return "absorbed"
        self.counters.accepted += 1
        place = bisect_right(self._keys, observation.place)
        if place and self._valid - place > AT_ONCE:
            self._late.add(observation, now_ns)
        else:
            self._place(observation)
        return None

    def untimely(self, at_ns: int, now_ns: int) -> str | None:
        """The reason for which an observation of this time would be refused; None if it would not."""
        return untimely(at_ns, max(self._boundary_ns, now_ns - self.horizon_ns), now_ns)

    def _take_late(self, late: list[Observation]) -> None:
        for observation in late:
            self._place(observation)

    def _place(self, observation: Observation) -> None:
        key = observation.place
        place = bisect_right(self._keys, key)
        if place < self._valid:
            self.counters.rewinds += 1
            self.counters.replayed += self._valid - place
            self._valid = place
        self._keys.insert(place, key)
        self._knots.insert(place, observation)
        self._states.insert(place, None)

    def _keep_the_least(self, observation: Observation) -> None:
        self._take_late(self._late.taken())
        place = bisect_left(self._keys, observation.place)
        if place == len(self._keys) or self._keys[place] != observation.place:
            return  # the base has absorbed it
        if rank(observation) < rank(self._knots[place]):
            self._knots[place] = observation
            self._valid = min(self._valid, place)

    def rebase(self, at_ns: int, state: Any) -> None:
        """Make `state` the belief at `at_ns`: it contains all observations until then; later ones are replayed on it."""
        self._take_late(self._late.taken())
        place = self._count_until(at_ns)
        self._drop(place)
        self._base, self._base_ns, self._rebased = state, at_ns, True
        self._states = [None] * len(self._knots)
        self._valid = 0

    def kept(self) -> Kept:
        """All that later beliefs depend on; the base is the belief after the last knot before the settled boundary.

        So a timeline that continues from it takes the same steps, and comes to the same bits.
        """
        self._take_late(self._late.taken())
        place = self._count_until(self._boundary_ns - 1)
        base, base_ns, rebased = self._base, self._base_ns, self._rebased
        if place:
            self._replay(place)
            base, base_ns, rebased = self._states[place - 1], self._keys[place - 1][0], False
        knots = tuple(self._knots[place:])
        absorbed = {identity for identity in self._seen if identity.measured_at_ns >= self._boundary_ns}
        return Kept(base, base_ns, rebased, self._boundary_ns, frozenset(absorbed - {o.identity for o in knots}), knots)

    @classmethod
    def resumed(cls, kernel: Kernel, horizon_ns: int, kept: Kept) -> Timeline:
        """A timeline that continues from what another one holds; its knots are in order."""
        out = cls(kernel, kept.base, horizon_ns)
        out._base_ns, out._rebased, out._boundary_ns = kept.base_ns, kept.rebased, kept.boundary_ns
        out._knots, out._keys = list(kept.knots), [o.place for o in kept.knots]
        out._states = [None] * len(kept.knots)
        out._seen = {*kept.absorbed, *(o.identity for o in kept.knots)}
        return out

    def state_at(self, at_ns: int) -> Any | None:
        """The belief at a time, from all observations until then; None before the base. A side branch: it adds no knot."""
        if self._late.earliest_ns <= at_ns:
            self._take_late(self._late.taken())
        return self._state_at(at_ns)

    def live_at(self, at_ns: int) -> Any | None:
        """The same, without observations that are so late that others like them are awaited."""
        self._take_late(self._late.due(self._boundary_ns + self.horizon_ns))
        return self._state_at(at_ns)

    def _state_at(self, at_ns: int) -> Any | None:
        place = self._count_until(at_ns)
        if place:
            self._replay(place)
            state, from_ns = self._states[place - 1], self._keys[place - 1][0]
        elif self._base_ns is not None and at_ns >= self._base_ns:
            state, from_ns = self._base, self._base_ns
        else:
            return None
        return self.kernel.advance(state, (at_ns - from_ns) * S_PER_NS) if at_ns > from_ns else state

    def _count_until(self, at_ns: int) -> int:
        """How many knots are at a time or before."""
        # a tuple of a time alone sorts before all places at that time
        return bisect_left(self._keys, (at_ns + 1,))

    def _replay(self, until: int) -> None:
        place = self._valid
        if place >= until:
            return
        advance, take = self.kernel.advance, self.kernel.take
        if place:
            state, at = self._states[place - 1], self._keys[place - 1][0]
        else:
            state, at = self._base, self._base_ns if self._base_ns is not None else self._keys[0][0]
        while place < until:
            knot = self._knots[place]
            if knot.measured_at_ns > at:
                state = advance(state, (knot.measured_at_ns - at) * S_PER_NS)
                at = knot.measured_at_ns
            state = take(state, knot)
            self._states[place] = state
            place += 1
        self._valid = until

    def advance_to(self, now_ns: int) -> None:
        """Advance the time to `now_ns`: move the settled boundary and fold settled observations into the base."""
        self._move_boundary(now_ns)
        if len(self._seen) >= self._forget_at:
            self._forget()
        if len(self._keys) < PRUNE_AT_LEAST or self._keys[PRUNE_AT_LEAST - 1][0] >= self._boundary_ns:
            return
        if self._late.earliest_ns < self._boundary_ns:
            self._take_late(self._late.taken())
        place = self._count_until(self._boundary_ns - 1)
        self._replay(place)
        state, at = self._states[place - 1], self._keys[place - 1][0]
        self._drop(place)
        self._base, self._base_ns = state, at

    def _forget(self) -> None:
        boundary = self._boundary_ns
        self._seen = {identity for identity in self._seen if identity.measured_at_ns >= boundary}
        self._forget_at = max(FORGET_AT_LEAST, 2 * len(self._seen))

    def _drop(self, place: int) -> None:
        del self._keys[:place], self._knots[:place], self._states[:place]
        self._valid = max(0, self._valid - place)

    def _move_boundary(self, now_ns: int) -> None:
        if now_ns - self.horizon_ns > self._boundary_ns:
            self._boundary_ns = now_ns - self.horizon_ns

    def _refuse(self, reason: str) -> str:
        self.counters.refused[reason] = self.counters.refused.get(reason, 0) + 1
        return reason
