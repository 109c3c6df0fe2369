"""Which satellite fixes deserve belief, judged by what they say and by the line alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

RTK = ("rtk_fixed", "rtk_float")
# a step of time longer than this is a gap: neither speed nor acceleration is read off it
GAP_S = 2.0
# how well a receiver's speed is known that serves as a check alone
SPEED_STD_MPS = 0.25


class SeenFix(NamedTuple):
    """A fix on the line: time s, what the receiver calls it, chainage m, distance from the track m, std m of one axis.

    `speed_mps` along the track, where the receiver gives it; `turned_deg` between course and track, where it is fast enough
    for a course to mean something.
    """

    t_s: float
    solution: str
    position_m: float
    cross_track_m: float
    std_m: float
    satellites: int | None = None
    speed_mps: float | None = None
    turned_deg: float | None = None


class Verdict(NamedTuple):
    """Why a fix does not count (None: it does), and what its standard deviation is multiplied with."""

    refused: str | None
    std_factor: float = 1.0


@dataclass(frozen=True, slots=True)
class FixLimits:
    """Limits of the monitor.

    `cross_track_m`: a fix farther from the track than this, and than `sigmas` standard deviations, is not this train's.
    `coasting_s`: after so long without a solution of its own, RTK in between taken off, a receiver is suspect; `proof_s`:
    until its fixes were sound for so long without a break. `max_acceleration_mps2`: of any train. `course_deg`: between
    course and track.
    `alone_above`, `least`: source C's satellite numbers: a stand-alone solution is good with more than the first, and none
    is with fewer than the second. `poor_factor`: on the standard deviation of a stand-alone solution with fewer.
    """

    cross_track_m: float = 10.0
    sigmas: float = 4.0
    coasting_s: float = 5.0
    proof_s: float = 6.0
    max_acceleration_mps2: float = 5.0
    course_deg: float = 20.0
    alone_above: int = 10
    least: int = 4
    poor_factor: float = 2.0


class FixMonitor:
    """A receiver's word for its solution is a claim: what calls itself RTK has to prove it after every long gap.

    Receivers that coast through a tunnel go on calling some fixes RTK-fixed while they drift hundreds of metres away,
    smoothly and in runs of up to four seconds; true RTK comes back to stay. So after `coasting_s` of coasting, in one piece
    or several, RTK counts only once it was sound for `proof_s` at a stretch. Sound: near the track, along it, and moving as
    a train can. A stand-alone solution claims little and proves nothing: it counts or not by its satellites and its
    distance from the track. Silence is not coasting. A fix that is not later than the last teaches nothing: it is judged by
    itself and by the credit that the receiver has.
    Source: C, its satellite monitor, whose verdict is one of several here; the rest is ours, from recorded logs.
    """

    def __init__(self, limits: FixLimits, known: Mapping[str, float]) -> None:
        self._limits, self._known = limits, known
        self._heard_s: float | None = None
        self._debt_s = 0.0
        self._proof_since_s: float | None = None
        self._last: SeenFix | None = None
        self._last_speed: tuple[float, float] | None = None
        self.suspect = False

    @property
    def memory(self) -> tuple[Any, ...]:
        """All that it remembers."""
        return self._heard_s, self._debt_s, self._proof_since_s, self._last, self._last_speed, self.suspect

    @memory.setter
    def memory(self, memory: tuple[Any, ...]) -> None:
        self._heard_s, self._debt_s, self._proof_since_s, self._last, self._last_speed, self.suspect = memory

    def judge(self, fix: SeenFix) -> Verdict:
        """The verdict on the next fix."""
        late = self._heard_s is not None and fix.t_s <= self._heard_s
        since_s = 0.0 if late or self._heard_s is None else min(fix.t_s - self._heard_s, GAP_S)
        self._heard_s = self._heard_s if late else fix.t_s
        if fix.solution not in self._known:
            if not late:
                self._coast(since_s)
            return Verdict("solution")
        reason = self._unsound(fix)
        if not late:
            reason = self._remember(fix, reason, since_s)
        elif self.suspect and fix.solution in RTK:
            # also one that was refused before and comes again
            reason = reason or "unproven"
        if reason is not None:
            return Verdict(reason)
        few = fix.solution == "single" and fix.satellites is not None and fix.satellites <= self._limits.alone_above
        return Verdict(None, self._limits.poor_factor if few else 1.0)

    def _coast(self, since_s: float) -> None:
        self._last, self._last_speed = None, None
        self._debt_s += since_s
        if self._debt_s >= self._limits.coasting_s:
            self.doubt()

    def doubt(self) -> None:
        """Let RTK prove itself from here on."""
        self.suspect, self._proof_since_s = True, None

    def _unsound(self, fix: SeenFix) -> str | None:
        limits = self._limits
        if fix.satellites is not None and fix.satellites < limits.least:
            return "satellites"
        # a distance that is no number fails too
        if not fix.cross_track_m <= max(limits.cross_track_m, limits.sigmas * fix.std_m):
            return "off_track"
        if fix.turned_deg is not None and abs(math.sin(math.radians(fix.turned_deg))) > math.sin(
            math.radians(limits.course_deg)
        ):
            return "off_course"
        return None

    def _remember(self, fix: SeenFix, reason: str | None, since_s: float) -> str | None:
        """Bring what is remembered up to this fix; returns why it does not count after all."""
        last, self._last = self._last, fix
        whole = last is not None and fix.t_s - last.t_s <= GAP_S
        if fix.solution not in RTK:
            self._proof_since_s = None
            return reason
        if last is None or not whole:
            self._last_speed = None
        elif reason is None and self._jumps(last, fix):
            self.doubt()
            return "jump"
        if not self.suspect:
            self._debt_s = max(0.0, self._debt_s - since_s)
            return reason
        if reason is not None or not whole or self._proof_since_s is None:
            self._proof_since_s = fix.t_s if reason is None else None
        if reason is None and self._proof_since_s is not None and fix.t_s - self._proof_since_s >= self._limits.proof_s:
            self.suspect, self._debt_s = False, 0.0
        return reason or ("unproven" if self.suspect else None)

    def _jumps(self, last: SeenFix, fix: SeenFix) -> bool:
        """Whether the speed implied by two fixes is not the receiver's own, or has changed since as no train's can.

        What a fix may be off the track, a kink of the map may make of it along the track.
        """
        limits, dt = self._limits, fix.t_s - last.t_s
        speed = (fix.position_m - last.position_m) / dt
        before, self._last_speed = self._last_speed, (fix.t_s, speed)
        allowed_m = limits.cross_track_m + limits.sigmas * math.hypot(last.std_m, fix.std_m)
        if fix.speed_mps is not None:
            allowed_m += (0.5 * limits.max_acceleration_mps2 * dt + limits.sigmas * SPEED_STD_MPS) * dt
            return abs(speed - fix.speed_mps) * dt > allowed_m
        if before is None:
            return False
        between = 0.5 * dt + 0.5 * (fix.t_s - before[0])
        return abs(speed - before[1]) * dt > allowed_m + limits.max_acceleration_mps2 * between * dt
