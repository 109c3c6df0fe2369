"""Creep of the wheels on the rail: events of the scenario, and traction or braking beyond poor adhesion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from milepost.track.line import Line

from .motion import Motion
from .noise import BLOCK, block_rng

GRAVITY_MPS2 = 9.80665
# the part of a patch in which the friction changes to that of the next patch
CHANGE_OVER = 0.2


@dataclass(frozen=True)
class CreepEvent:
    """A spin (ratio above 0) or slide (below 0) in [from_s, to_s], with smooth ramps; `units` None: all of them."""

    from_s: float
    to_s: float
    ratio: float
    ramp_s: float = 0.5
    units: tuple[str, ...] | None = None

    def at(self, t_s: float) -> float:
        """The event's creep ratio: `ratio` times a smooth step up and down, each over `ramp_s`."""
        if not self.from_s < t_s < self.to_s:
            return 0.0
        ramp_s = min(self.ramp_s, 0.5 * (self.to_s - self.from_s))
        edge_s = min(t_s - self.from_s, self.to_s - t_s)
        if edge_s >= ramp_s:
            return self.ratio
        part = edge_s / ramp_s
        return self.ratio * part * part * (3.0 - 2.0 * part)


@dataclass(frozen=True)
class Adhesion:
    """Friction μ in patches along the line: uniform in `dry`, or, in a share `poor_part` of the patches, in `poor`.

    `driven_part`: the share of the train's weight on axles that drive or brake. `creep_per_excess`: how much creep each
    unit of demanded over available force, less one, makes; at most `largest_creep`. `units` None: all of them.
    """

    dry: tuple[float, float] = (0.15, 0.30)
    poor: tuple[float, float] = (0.03, 0.08)
    poor_part: float = 0.1
    patch_m: float = 40.0
    driven_part: float = 0.67
    creep_per_excess: float = 0.3
    largest_creep: float = 0.5
    units: tuple[str, ...] | None = None


class Creep:
    """The creep ratio c(t) of each unit's wheel, whose surface speed is v (1 + c): a pure function of time and seed.

    Spontaneous creep: with demand d = a + g i (acceleration and slope i) and available b = μ(s) g p (driven part p),
    c = sign(d) min(k (|d|/b - 1), c_max) where |d| > b. Milepost's model; source D observes this creep and has no model of it.
    """

    def __init__(self, motion: Motion, line: Line, seed: int, events: Sequence[CreepEvent], adhesion: Adhesion | None) -> None:
        self._motion, self._line, self._seed = motion, line, seed
        self._events = tuple(events)
        self._adhesion = adhesion
        self._block = -1
        self._frictions: list[float] = []

    def at(self, unit: str, t_s: float) -> float:
        """The creep ratio of a unit's wheel: the sum of events and spontaneous creep, at least -1, a locked wheel's."""
        ratio = sum(event.at(t_s) for event in self._events if event.units is None or unit in event.units)
        if self._adhesion is not None and (self._adhesion.units is None or unit in self._adhesion.units):
            ratio += self._spontaneous(self._adhesion, t_s)
        return max(ratio, -1.0)

    def _spontaneous(self, adhesion: Adhesion, t_s: float) -> float:
        s, _, a = self._motion.at(t_s)
        demand = a + GRAVITY_MPS2 * self._line.slope_at(s)
        excess = abs(demand) / (self.friction(s) * GRAVITY_MPS2 * adhesion.driven_part) - 1.0
        if excess <= 0.0:
            return 0.0
        return math.copysign(min(adhesion.creep_per_excess * excess, adhesion.largest_creep), demand)

    def friction(self, position_m: float) -> float:
        """μ at a position: constant over a patch, and linear over its last fifth to the next one's. Needs adhesion."""
        if self._adhesion is None:
            raise ValueError("a world without adhesion has no friction")
        place = position_m / self._adhesion.patch_m
        patch = math.floor(place)
        over = (place - patch - (1.0 - CHANGE_OVER)) / CHANGE_OVER
        here = self._friction_of(self._adhesion, patch)
        return here if over <= 0.0 else here + over * (self._friction_of(self._adhesion, patch + 1) - here)

    def _friction_of(self, adhesion: Adhesion, patch: int) -> float:
        block, place = divmod(max(patch, 0), BLOCK)
        if block != self._block:
            drawn = block_rng(self._seed, "adhesion", block).random((BLOCK, 2)).tolist()
            ranges = [(adhesion.poor if which < adhesion.poor_part else adhesion.dry, part) for which, part in drawn]
            self._frictions = [low + part * (high - low) for (low, high), part in ranges]
            self._block = block
        return self._frictions[place]
