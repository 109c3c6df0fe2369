"""What linking is told and what it says: the published interval at a time, a telegram, an irregularity."""

from __future__ import annotations

from typing import Literal, NamedTuple

S_PER_NS = 1e-9
# by what a speed bound may be left in the time over which an interval is carried: more than an emergency brake does
ACCELERATION_MPS2 = 3.0

Severity = Literal["info", "warning", "error"]


class Irregularity(NamedTuple):
    """An event of linking: severity, code, and a text with the evidence. `detail`: the same in a few words, for the fix."""

    severity: Severity
    code: str
    text: str
    detail: str = ""


class Interval(NamedTuple):
    """The published interval of position and speed at a time; every true value lies inside."""

    at_ns: int
    low_m: float
    high_m: float
    slow_mps: float
    fast_mps: float

    def carried(self, to_ns: int) -> Interval:
        """The interval at another time: s₁ + v₁T - bT²/2 … s₂ + v₂T + bT²/2, before its own time with v₁ and v₂ exchanged.

        s₁, s₂ in m and v₁, v₂ in m/s are the bounds, T in s, b the greatest acceleration in m/s². It never becomes narrower.
        """
        T = (to_ns - self.at_ns) * S_PER_NS
        behind, ahead = (self.slow_mps, self.fast_mps) if T >= 0.0 else (self.fast_mps, self.slow_mps)
        change_mps = ACCELERATION_MPS2 * abs(T)
        spread_m = 0.5 * change_mps * abs(T)
        return Interval(
            to_ns,
            self.low_m + behind * T - spread_m,
            self.high_m + ahead * T + spread_m,
            self.slow_mps - change_mps,
            self.fast_mps + change_mps,
        )

    @property
    def direction(self) -> int:
        """1 or -1 where the train surely moves towards higher or lower chainage, otherwise 0."""
        return 1 if self.slow_mps > 0.0 else -1 if self.fast_mps < 0.0 else 0

    def __str__(self) -> str:
        return f"the train was at {self.low_m:.2f} to {self.high_m:.2f} m"


class Telegram(NamedTuple):
    """A telegram: its reader, the balise's index on the line, the time of passage, and the reader's variance in m²."""

    reader: str
    balise: int
    at_ns: int
    variance_m2: float


class Taken(NamedTuple):
    """What was found about a telegram, and whether it is the first one of a passage over the balise that it names."""

    found: list[Irregularity]
    passed: bool
