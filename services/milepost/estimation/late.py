"""Late observations that wait, so that a sensor whose every reading is seconds late does not have seconds computed for each."""

from __future__ import annotations

from .observation import Observation, rank

# a late observation that makes more beliefs than this be computed again waits for others
AT_ONCE = 32
# what an interruption kept back comes within so long
TOGETHER_NS = 50_000_000
NEVER_NS = 1 << 63


class Late:
    """Observations that are taken in together, at most once in the time by which they are late.

    So no belief is computed more than twice for them, on average, however late they are. `earliest_ns`: the earliest of their
    times.
    """

    def __init__(self) -> None:
        self._waiting: list[Observation] = []
        self.earliest_ns = NEVER_NS
        self._due_ns = NEVER_NS
        self._taken_ns = 0

    def add(self, observation: Observation, now_ns: int) -> None:
        """Keep one that came now."""
        at = observation.measured_at_ns
        if not self._waiting:
            self._due_ns = max(now_ns + TOGETHER_NS, self._taken_ns + now_ns - at)
        self._waiting.append(observation)
        self.earliest_ns = min(self.earliest_ns, at)

    def keep_the_least(self, observation: Observation) -> None:
        """Of several with the same identity the least stays."""
        for i, other in enumerate(self._waiting):
            if other.place == observation.place and rank(observation) < rank(other):
                self._waiting[i] = observation

    def due(self, now_ns: int) -> list[Observation]:
        """All, where it is time to take them in."""
        if now_ns < self._due_ns:
            return []
        self._taken_ns = now_ns
        return self.taken()

    def taken(self) -> list[Observation]:
        """All, whatever the time."""
        out, self._waiting = self._waiting, []
        self.earliest_ns = self._due_ns = NEVER_NS
        return out
