"""What a receiver's decoders share: the parts of one epoch joined to one fix, and what was skipped counted by reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

# a kind of part that was absent for so many epochs is no longer waited for
FORGET_AFTER = 5


class Fix(NamedTuple):
    """A receiver's fix: UTC in seconds since 1970 at which it is true, and the fields of a position reading."""

    utc_s: float
    fields: dict[str, Any]


class Decoder(Protocol):
    """Bytes in, however they were cut, fixes out; what cannot be used is counted in `skipped` by reason."""

    skipped: dict[str, int]

    def feed(self, data: bytes) -> list[Fix]:
        """The fixes that these bytes complete."""

    def finish(self) -> list[Fix]:
        """The fixes that were waiting for more when the bytes ended."""


@dataclass(slots=True)
class Skips:
    """A count by reason."""

    counts: dict[str, int] = field(default_factory=dict)

    def add(self, reason: str) -> None:
        """Count one."""
        self.counts[reason] = self.counts.get(reason, 0) + 1


class Epochs:
    """Parts that carry the same time belong together: an epoch ends when the next begins, or as soon as it is complete.

    Complete means that every kind of part which came in one of the last epochs has come, so that a fix need not wait
    for the next epoch. What comes for an epoch that has ended is `late`.
    """

    def __init__(self, skips: Skips) -> None:
        self._skips = skips
        self._key: Any = None
        self._parts: dict[str, Any] = {}
        self._ended = True
        self._absent: dict[str, int] = {}

    def add(self, key: Any, kind: str, part: Any) -> list[Mapping[str, Any]]:
        """Take a part; returns the epochs, as parts by kind, that end by it."""
        out: list[Mapping[str, Any]] = []
        if key != self._key:
            out = self.end()
            self._key, self._parts, self._ended = key, {}, False
        if self._ended:
            self._skips.add("late")
            self._absent[kind] = 0
            return out
        self._parts[kind] = part
        if self._absent and self._absent.keys() <= self._parts.keys():
            out += self.end()
        return out

    def end(self) -> list[Mapping[str, Any]]:
        """End the epoch; returns it if it had not ended before."""
        if self._ended:
            return []
        self._ended = True
        ages = {kind: age + 1 for kind, age in self._absent.items() if age + 1 < FORGET_AFTER}
        self._absent = ages | dict.fromkeys(self._parts, 0)
        return [self._parts]
