"""Which part of a line a fix belongs to, where the line comes near itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from milepost.track.track import Projection, Track

from ..observed import Belief

# how far a belief and a fix may be from each other, in standard deviations of their difference
BELIEF_SIGMAS = 6.0
# parts of a line are distinct where they are farther apart along it than this many limits: no railway turns about in less
APART_LIMITS = 4.0


@dataclass(frozen=True, slots=True)
class Legs:
    """The parts of a line that a fix may belong to. `limit_m`: how far from the track a fix may lie at most."""

    track: Track
    limit_m: float

    def exist(self) -> bool:
        """Whether a fix of one part may lie nearer to another: whether the line comes within two limits of itself."""
        return self.track.comes_near_itself(2.0 * self.limit_m, APART_LIMITS * self.limit_m)

    def near(self, latitude_deg: float, longitude_deg: float) -> list[Projection]:
        """The parts near a fix: those that it may belong to, and those from which it may have strayed to them."""
        return self.track.legs(latitude_deg, longitude_deg, 3.0 * self.limit_m, APART_LIMITS * self.limit_m)

    def believed(self, near: Sequence[Projection], belief: Belief | None, std_m: float, farthest_m: float) -> Projection | None:
        """The part that a fix belongs to, of at least one near it; None where two of them are equally likely.

        A part agrees with the belief where |s - ŝ| ≤ 6 √(P_ss + σ²) + `limit_m`; every part does where there is no belief.
        A fix that is near no such part does not belong to another one instead: the believed part is farther than it may be.
        `std_m`: σ of the fix. `farthest_m`: how far from the track this fix may lie.
        """
        agreeing = [leg for leg in near if belief is None or self._agrees(leg, belief, std_m)]
        for some in (agreeing, near):
            fitting = [leg for leg in some if abs(leg.cross_track_m) <= farthest_m]
            if fitting:
                return fitting[0] if len(fitting) == 1 else None
            if some:
                return some[0]
        raise ValueError("no part of the line is near")

    def _agrees(self, leg: Projection, belief: Belief, std_m: float) -> bool:
        reach_m = BELIEF_SIGMAS * math.sqrt(float(belief.covariance[0, 0]) + std_m * std_m) + self.limit_m
        return abs(leg.position_m - float(belief.mean[0])) <= reach_m
