"""A timeline of observations, in the order of the times at which they were true.

Every observation is a knot; the belief after each knot is kept as a checkpoint. A late observation is inserted at its
place, and the beliefs after it are computed again when they are needed. Because only observations are knots, the result
is a function of the set of observations alone: the same bits for any order of arrival.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Any

from .chain import Chain, Kernel
from .kept import Counters, Kept
from .late import AT_ONCE, Late
from .observation import Identity, Observation, rank, untimely

# deleting from the front of a list costs its length, so it is done for many knots at once
PRUNE_AT_LEAST = 256
FORGET_AT_LEAST = 2048


class Timeline:
    """Observations over a sliding horizon, and the belief at any time in it.

    `prior` is the kernel's state before the earliest observation, and moves back if an earlier one arrives; after
    `rebase` the base is fixed at a time instead. The settled boundary is `now` - `horizon_ns`, `now` being the largest
    time so far: older observations are refused, and states before it can no longer change. `state_at` has all observations;
    `live_at` may still lack some that came late (see `late`).
    """

    def __init__(self, kernel: Kernel, prior: Any, horizon_ns: int) -> None:
        self.horizon_ns = horizon_ns
        self.counters = Counters()
        self._chain = Chain(kernel, prior)
        # while late observations are being taken in: the chain without them
        self._live: Chain | None = None
        self._late = Late()
        # so many observations came into it since the last live state
        self._prompt = 0
        self._rebased = False
        self._seen: set[Identity] = set()
        self._boundary_ns = 0
        self._forget_at = FORGET_AT_LEAST

    @property
    def kernel(self) -> Any:
        """The mathematics of its steps; another one takes those to come."""
        return self._chain.kernel

    @kernel.setter
    def kernel(self, kernel: Kernel) -> None:
        self._chain.kernel = kernel

    @property
    def base_ns(self) -> int | None:
        """The time at which the base is fixed; None while the prior still moves with the earliest observation."""
        return self._chain.base_ns

    @property
    def boundary_ns(self) -> int:
        """The settled boundary: states before this time no longer change."""
        return self._boundary_ns

    @property
    def earliest_ns(self) -> int | None:
        """The time of the earliest observation, or of the base where it is fixed."""
        chain = self._chain
        return chain.base_ns if chain.base_ns is not None else chain.keys[0][0] if chain.keys else None

    @property
    def latest_ns(self) -> int | None:
        """The time of the latest observation, or of the base where there is none after it."""
        return self._chain.keys[-1][0] if self._chain.keys else self._chain.base_ns

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
        if self._rebased and self.base_ns is not None and at <= self.base_ns:
            return "absorbed"
        self.counters.accepted += 1
        if self._chain.behind(observation) > AT_ONCE:
            self._late.add(observation, now_ns)
        else:
            self._place(observation)
            if self._live is not None and self._live.behind(observation) <= AT_ONCE:
                self._live.place(observation)
                self._prompt += 1
        return None

    def untimely(self, at_ns: int, now_ns: int) -> str | None:
        """The reason for which an observation of this time would be refused; None if it would not."""
        return untimely(at_ns, max(self._boundary_ns, now_ns - self.horizon_ns), now_ns)

    def _place(self, observation: Observation) -> None:
        lost = self._chain.place(observation)
        if lost:
            self.counters.rewinds += 1
            self.counters.replayed += lost

    def _take_late(self) -> None:
        for observation in self._late.taken():
            self._place(observation)

    def _take_aside(self, late: list[Observation]) -> None:
        """Take in what came late; live states go on without it until its beliefs are computed."""
        if late and self._live is None:
            self._live = self._chain.copy()
        for observation in late:
            self._place(observation)

    def _keep_the_least(self, observation: Observation) -> None:
        chain, key = self._chain, observation.place
        place = bisect_left(chain.keys, key)
        if place == len(chain.keys) or chain.keys[place] != key:
            self._late.keep_the_least(observation)  # or the base has absorbed it
            return
        if rank(observation) < rank(chain.knots[place]):
            chain.knots[place], self._live = observation, None
            chain.valid = min(chain.valid, place)

    def rebase(self, at_ns: int, state: Any) -> None:
        """Make `state` the belief at `at_ns`: it contains all observations until then; later ones are replayed on it."""
        self._take_late()
        self._chain.rebase(at_ns, state)
        self._live, self._rebased = None, True

    def kept(self) -> Kept:
        """All that later beliefs depend on; the base is the belief after the last knot before the settled boundary.

        So a timeline that continues from it takes the same steps, and comes to the same bits.
        """
        self._take_aside(self._late.taken())
        base, base_ns, place = self._chain.before(self._boundary_ns)
        knots = tuple(self._chain.knots[place:])
        absorbed = {identity for identity in self._seen if identity.measured_at_ns >= self._boundary_ns}
        absorbed -= {o.identity for o in knots}
        return Kept(base, base_ns, self._rebased and not place, self._boundary_ns, frozenset(absorbed), knots)

    @classmethod
    def resumed(cls, kernel: Kernel, horizon_ns: int, kept: Kept) -> Timeline:
        """A timeline that continues from what another one holds; its knots are in order."""
        out = cls(kernel, kept.base, horizon_ns)
        out._chain = Chain(kernel, kept.base, kept.base_ns, kept.knots)
        out._rebased, out._boundary_ns = kept.rebased, kept.boundary_ns
        out._seen = {*kept.absorbed, *(o.identity for o in kept.knots)}
        return out

    def state_at(self, at_ns: int) -> Any | None:
        """The belief at a time, from all observations until then; None before the base. A side branch: it adds no knot."""
        if self._late.earliest_ns <= at_ns:
            self._take_late()
        return self._chain.state_at(at_ns)

    def live_at(self, at_ns: int, at_a_time: int) -> Any | None:
        """The same, without observations that came so late that others like them are awaited, or are being taken in.

        For them so many beliefs are computed again, and two for each of the others since the last time.
        """
        chain = self._chain
        self._take_aside(self._late.due(self._boundary_ns + self.horizon_ns))
        prompt, self._prompt = self._prompt, 0
        if self._live is not None:
            until = chain.count_until(at_ns)
            chain.replay(min(until, chain.valid + at_a_time + 2 * prompt))
            if chain.valid < until:
                return self._live.state_at(at_ns)
            self._live = None
        return chain.state_at(at_ns)

    def advance_to(self, now_ns: int) -> None:
        """Advance the time to `now_ns`: move the settled boundary and fold settled observations into the base."""
        self._move_boundary(now_ns)
        if len(self._seen) >= self._forget_at:
            self._forget()
        keys = self._chain.keys
        if len(keys) < PRUNE_AT_LEAST or keys[PRUNE_AT_LEAST - 1][0] >= self._boundary_ns:
            return
        if self._late.earliest_ns < self._boundary_ns:
            self._take_aside(self._late.taken())
        for chain in (self._chain, self._live):
            if chain is not None:
                chain.fold(self._boundary_ns)

    def _forget(self) -> None:
        boundary = self._boundary_ns
        self._seen = {identity for identity in self._seen if identity.measured_at_ns >= boundary}
        self._forget_at = max(FORGET_AT_LEAST, 2 * len(self._seen))

    def _move_boundary(self, now_ns: int) -> None:
        if now_ns - self.horizon_ns > self._boundary_ns:
            self._boundary_ns = now_ns - self.horizon_ns

    def _refuse(self, reason: str) -> str:
        self.counters.refused[reason] = self.counters.refused.get(reason, 0) + 1
        return reason
