"""What `milepost up` says while a train starts: each process as its token appears, then the first state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

Say = Callable[[str], None]


class Arrivals:
    """The processes that are expected and those that have come. `age_s`: seconds since the command began."""

    def __init__(self, expected: Sequence[str], say: Say, age_s: Callable[[], float]) -> None:
        self._missing = list(expected)
        self._count = len(expected)
        self._say = say
        self._age_s = age_s
        self.done = False

    @property
    def missing(self) -> list[str]:
        """Who has not come yet, in order."""
        return list(self._missing)

    def came(self, name: str) -> None:
        """A process's token appeared."""
        if name not in self._missing:
            return
        self._missing.remove(name)
        self._say(f"{name} is there ({self._count - len(self._missing)} of {self._count})")

    def state(self) -> None:
        """A state came."""
        if not self.done:
            self.done = True
            self._say(f"first state after {self._age_s():.1f} s")
