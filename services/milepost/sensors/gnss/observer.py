"""What a receiver's fixes say of the train: projected on the line, judged, and made into observations."""

from __future__ import annotations

import math
from collections.abc import Sequence

from milepost.estimation.notice import Notice
from milepost.track.track import Projection, Track
from milepost_schemas import PositionReading

from ..observed import Belief, Observed
from .fix_monitor import FixMonitor, Memory
from .fix_motion import SeenFix
from .legs import Legs
from .options import GnssOptions

# below this a course over ground says nothing
LEAST_COURSE_SPEED_MPS = 3.0
# of the Doppler speed of a receiver that states none, where it serves to check its fixes only
DEFAULT_SPEED_STD_MPS = 0.2

# why RTK has to prove itself, by the reason for which a fix was refused
DOUBTS = {
    "jump": "its fixes move as no train can",
    "cross_track_jump": "its fixes jump across the track",
    "frozen": "its position stands still as no train can",
    "off_track_mean": "its fixes lie beside the track",
}
# what else a person should know of refused fixes, when it begins
REMARKS = {
    "frozen": "its position stands still as no train can: its fixes do not count",
    "ambiguous": "its fixes are near two parts of the line, and the position is not known well enough to choose",
    "off_line": "its fixes lie before or beyond the line: they do not count",
}


class GnssObserver:
    """Projects fixes on the track and lets the monitor say which of them count.

    `legs`: given where the line comes near itself; a fix is then projected on the part that the belief points to.
    """

    def __init__(self, unit: str, options: GnssOptions, track: Track | None, legs: Legs | None, private: int) -> None:
        self._unit, self._options, self._track, self._legs, self._private = unit, options, track, legs, private
        self._limits = options.limits
        if track is None:
            self._monitor = FixMonitor(self._limits, options.position_std_m)
        else:
            self._monitor = FixMonitor(self._limits, options.position_std_m, track.length_m, track.turning)
        self._refused: str | None = None
        self._notices: list[Notice] = []

    @property
    def memory(self) -> Memory:
        """What is remembered of the fixes so far; set to an earlier value, it continues from there."""
        return self._monitor.memory

    @memory.setter
    def memory(self, earlier: Memory) -> None:
        self._monitor.memory = earlier

    def notices(self) -> list[Notice]:
        """When the receiver lost trust and when it regained it, and what is strange about its fixes."""
        notices, self._notices = self._notices, []
        return notices

    def restarted(self) -> None:
        """It may have been in the middle of a tunnel: RTK has to prove itself."""
        self._monitor.doubt()

    @property
    def gating(self) -> str | None:
        """Nothing: what counts of a fix does not depend on how well it agrees with the fused state."""
        return None

    @property
    def refused(self) -> str | None:
        """The monitor's reason for the last fix."""
        return self._refused

    def observe(self, reading: PositionReading, belief: Belief | None) -> Sequence[Observed]:
        """The projected fix and the speed along the track, where they count."""
        if self._track is None:
            return ()
        options, solution = self._options, reading.solution
        std = options.position_std_m.get(solution, math.inf)
        stated = options.trust_stated_std and reading.horizontal_std_m is not None and solution in options.position_std_m
        if stated and reading.horizontal_std_m is not None:
            std = reading.horizontal_std_m
        offset_std = options.offset_std_m.get(solution, 0.0)
        seen, ambiguous = self._seen(self._track, reading, belief, math.hypot(std, offset_std))
        speed, turned = self._along(self._track, reading, seen.position_m)
        fix = SeenFix(
            reading.measured_at_ns * 1e-9,
            solution,
            seen.position_m,
            seen.cross_track_m,
            math.hypot(std, offset_std),
            reading.satellites,
            None if speed is None else speed.value,
            turned,
            ambiguous,
        )
        suspect = self._monitor.suspect
        refused, factor = self._monitor.judge(fix)
        self._tell(suspect, refused)
        if refused is not None:
            return ()
        if not stated:
            std *= factor
        own = (offset_std,) * self._private
        place = Observed((1.0, 0.0, 0.0, *own), seen.position_m, std * std)
        return (place,) if speed is None or options.speed_std_mps is None else (place, speed)

    def _seen(self, track: Track, reading: PositionReading, belief: Belief | None, std_m: float) -> tuple[Projection, bool]:
        """The fix as seen from the part of the line that it belongs to, and whether that is ambiguous."""
        near = [] if self._legs is None else self._legs.near(reading.latitude_deg, reading.longitude_deg)
        if self._legs is None or not near:
            return track.project(reading.latitude_deg, reading.longitude_deg), False
        leg = self._legs.believed(near, belief, std_m, self._limits.farthest_m(std_m))
        return (near[0], True) if leg is None else (leg, False)

    def _along(self, track: Track, reading: PositionReading, position_m: float) -> tuple[Observed | None, float | None]:
        """The speed along the track as an observation, and by how much the course is turned from the track."""
        if reading.speed_mps is None:
            return None, None
        std = reading.speed_std_mps or self._options.speed_std_mps or DEFAULT_SPEED_STD_MPS
        row = (0.0, 1.0, 0.0) + (0.0,) * self._private
        if reading.course_deg is None:
            if reading.speed_mps > 3.0 * std:
                return None, None
            return Observed(row, 0.0, reading.speed_mps**2 + std * std), None
        turned = reading.course_deg - track.heading_deg(position_m)
        along = Observed(row, reading.speed_mps * math.cos(math.radians(turned)), std * std)
        return along, turned if reading.speed_mps > LEAST_COURSE_SPEED_MPS else None

    def _tell(self, suspect: bool, refused: str | None) -> None:
        if self._monitor.suspect and not suspect:
            reason = DOUBTS.get(refused or "", "it has coasted for long")
            self._notices.append(Notice("warning", "gnss_not_trusted", f"{self._unit}: {reason}: RTK has to prove itself"))
        elif suspect and not self._monitor.suspect:
            self._notices.append(Notice("info", "gnss_trusted_again", f"{self._unit}: RTK has proved itself"))
        elif refused in REMARKS and refused != self._refused:
            self._notices.append(Notice("warning", f"gnss_{refused}", f"{self._unit}: {REMARKS[refused]}"))
        self._refused = refused
