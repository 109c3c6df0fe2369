"""The time that a recorded train went by: UTC, or on a simulated train its scenario's time, which may run faster."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# the names of what a recorder writes about a recording: its scenario time, and the train file and version it was made with
SIMULATION, MADE_OF = "simulation", "train"


def simulation_facts(start_ns: int, speed: float) -> dict[str, str]:
    """What a recorder writes of scenario time."""
    return {"start_ns": str(start_ns), "speed": repr(speed)}


@dataclass(frozen=True)
class ScenarioClock:
    """t_0 + (UTC - t_0) · speed."""

    start_ns: int = 0
    speed: float = 1.0

    @classmethod
    def of(cls, metadata: Mapping[str, Mapping[str, str]]) -> ScenarioClock:
        """The clock that a recording names; UTC where it names none."""
        facts = metadata.get(SIMULATION, {})
        try:
            return cls(int(facts["start_ns"]), float(facts["speed"]))
        except (KeyError, ValueError):
            return cls()

    def at(self, utc_ns: int) -> int:
        """The time at a wall-clock time."""
        return utc_ns if self.speed == 1.0 else self.start_ns + round((utc_ns - self.start_ns) * self.speed)
