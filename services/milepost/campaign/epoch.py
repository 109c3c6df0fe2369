"""What a run is measured by: epochs, states beside the truth, and spells, in which units lie."""

from __future__ import annotations

from typing import NamedTuple

from .watch import Seen


class Spell(NamedTuple):
    """The fault of a unit: from when to when, in scenario time; `to_s` is infinite where it does not end.

    `acts`: whether there was anything for it to act on; a reader that passes no balise cannot lie.
    """

    unit: str
    from_s: float
    to_s: float
    acts: bool = True


class Epoch(NamedTuple):
    """A live state beside the true position and speed."""

    t_s: float
    state: Seen
    position_m: float
    speed_mps: float

    @property
    def outside_position(self) -> bool:
        """Whether the true position is outside the interval."""
        return not self.state.position_min_m <= self.position_m <= self.state.position_max_m

    @property
    def outside_speed(self) -> bool:
        """Whether the true speed is outside the interval."""
        return not self.state.speed_min_mps <= self.speed_mps <= self.state.speed_max_mps

    @property
    def outside(self) -> bool:
        """Whether either is outside."""
        return self.outside_position or self.outside_speed

    @property
    def excluded(self) -> set[str]:
        """The units that are excluded."""
        return {unit for unit, _ in self.state.excluded}
