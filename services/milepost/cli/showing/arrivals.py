"""What `milepost up` says while trains start: each process as its token appears, then each train's first state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

Say = Callable[[str], None]
# of more than so many processes only every tenth part is told
MOST_NAMED = 100


class Arrivals:
    """The processes that are expected and those that have come. `age_s`: seconds since the command began.

    `trains`: those of which a first state is expected; of several, each is named.
    """

    def __init__(self, expected: Sequence[str], trains: Sequence[str], say: Say, age_s: Callable[[], float]) -> None:
        self._missing = list(expected)
        self._count = len(expected)
        self._several = len(trains) > 1
        self._silent = set(trains)
        self._say = say
        self._age_s = age_s

    @property
    def missing(self) -> list[str]:
        """Who has not come yet, in order."""
        return list(self._missing)

    @property
    def done(self) -> bool:
        """Whether every train has had its first state."""
        return not self._silent

    def came(self, name: str, train: str = "") -> None:
        """A process's token appeared."""
        name = f"{train} {name}" if self._several and train else name
        if name not in self._missing:
            return
        self._missing.remove(name)
        there, whole = self._count - len(self._missing), self._count
        if whole <= MOST_NAMED:
            self._say(f"{name} is there ({there} of {whole})")
        elif there * 10 // whole > (there - 1) * 10 // whole:
            self._say(f"{there} of {whole} processes are there")

    def state(self, train: str) -> None:
        """A state came."""
        if train in self._silent:
            self._silent.remove(train)
            self._say(f"{f'{train}: ' if self._several else ''}first state after {self._age_s():.1f} s")
