"""What a timeline counts, and what it hands over to another one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from .observation import Identity, Observation


@dataclass(slots=True)
class Counters:
    """The numbers of accepted, rewound, replayed and, by reason, refused observations."""

    accepted: int = 0
    rewinds: int = 0
    replayed: int = 0
    refused: dict[str, int] = field(default_factory=dict)


class Kept(NamedTuple):
    """What a timeline holds: the belief before the knots and its time, and the identities seen that are no knots' any more."""

    base: Any
    base_ns: int | None
    rebased: bool
    boundary_ns: int
    absorbed: frozenset[Identity]
    knots: tuple[Observation, ...]
