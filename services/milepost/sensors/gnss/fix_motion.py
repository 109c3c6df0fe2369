"""What a train can do between satellite fixes: bounds on its change of speed and on its steps across the track."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import NamedTuple

# intervals over which the motion is judged; 0 stands for that between neighbouring fixes
LAGS_S = (0.0, 1.0, 2.0, 4.0)
# two of the longest interval, and a fix more
WINDOW_S = 8.5
# stamps in nanoseconds since 1970 lose this much as seconds in a float, and receivers do not keep their grid exactly
STAMP_S = 1e-3
# standard deviation of a receiver's own speed, which only checks its positions here
SPEED_STD_MPS = 0.25
# how far a receiver whose output stands still may move on each axis, and over how many fixes unless they are identical
STILL_M, STILL_FIXES = 0.1, 3
IDENTICAL_M = 1e-3
# metres aside per metre along: the steepest turnout (1:9), and more than a map errs in direction
DIVERGENCE = 0.12


class SeenFix(NamedTuple):
    """A fix on the line: time s, solution, chainage m, distance to the right of the track m, std m of one axis.

    `speed_mps` along the track, where the receiver gives it; `turned_deg` between course and track, where it is fast enough
    for a course to mean something. `ambiguous`: two parts of the line are equally likely.
    """

    t_s: float
    solution: str
    position_m: float
    cross_track_m: float
    std_m: float
    satellites: int | None = None
    speed_mps: float | None = None
    turned_deg: float | None = None
    ambiguous: bool = False


# fixes in order of time between which a train can have moved
Run = tuple[SeenFix, ...]


class Still(NamedTuple):
    """A receiver's output stands still: since which fix, for how many fixes, after which run; `frozen`: no train stood so."""

    first: SeenFix
    fixes: int
    before: Run
    frozen: bool = False


def extended(run: Run, fix: SeenFix) -> Run:
    """The run and its next fix, without what is older than the window."""
    return (*run[_count_until(run, fix.t_s - WINDOW_S, len(run)) :], fix)


class MotionTest:
    """Whether a train can have moved from fix to fix; along the track and across it apart from each other.

    Along: mean speeds over [t_i, t_j] and [t_j, t_k] of a train whose acceleration stays within ±a differ by at most
    a (t_k - t_i)/2, and fixes err by their standard deviations σ, so that
    |v_jk - v_ij| ≤ a t_ik/2 + n √(σ_i²/t_ij² + σ_j² (1/t_ij + 1/t_jk)² + σ_k²/t_jk²) + K_ij/t_ij + K_jk/t_jk,
    tried at t_ij = t_jk = one fix, 1, 2 and 4 s. K = |c| Θ: at a distance c beside a polyline that turns by Θ between two
    fixes, the nearest point advances by so much more or less than the train.
    Across: |c_k - c_j| ≤ 0.12 |s_k - s_j| + n √(σ_j² + σ_k²).
    The receiver's own speed, where it gives it: the way between fixes is its integral, within its error, and it changes by
    at most a t.
    `acceleration_mps2`: a. `sigmas`: n. `turning`: Θ in radians between two chainages.
    """

    def __init__(self, acceleration_mps2: float, sigmas: float, turning: Callable[[float, float], float]) -> None:
        self._a, self._sigmas, self._turning = acceleration_mps2, sigmas, turning

    def impossible(self, run: Run, fix: SeenFix) -> str | None:
        """Why no train can have come from the run to this fix; None if one can, or after a gap longer than the window."""
        if run and fix.t_s - run[-1].t_s > WINDOW_S:
            return None
        tried = (-1, -1)
        for lag_s in LAGS_S:
            j = _count_until(run, fix.t_s - lag_s, len(run)) - 1
            if j < 0:
                break
            i = _count_until(run, run[j].t_s - lag_s, j) - 1
            # fixes may be farther apart than the interval
            if (i, j) == tried:
                continue
            tried = (i, j)
            if self._steps_aside(run[j], fix):
                return "cross_track_jump"
            if i >= 0 and self._changes_speed(run[i], run[j], fix):
                return "jump"
        return "jump" if self._denies_own_speed(run, fix) else None

    def stood(self, still: Still | None, run: Run, fix: SeenFix) -> Still:
        """How the receiver's output stands still after the next fix. `run`: the fixes before it that were possible."""
        if still is None or _distance_m(still.first, fix) > STILL_M:
            return Still(fix, 1, run)
        now = still._replace(fixes=still.fixes + 1)
        if now.frozen or not (now.fixes >= STILL_FIXES or _distance_m(now.first, fix) <= IDENTICAL_M):
            return now
        return now._replace(frozen=self._stands_too_soon(now, fix))

    def _stands_too_soon(self, still: Still, fix: SeenFix) -> bool:
        """Whether no train that moved as before can stand since the first still fix.

        With v_ij of the run before, and standing from t_1 to t_k: |v_ij| > a ((t_1 + t_k)/2 - (t_i + t_j)/2), beyond the
        error of v_ij and what STILL_M allows. That the fixes are the same is no chance: their own error does not enter.
        """
        first_s, stood_s = still.first.t_s, fix.t_s - still.first.t_s
        if fix.speed_mps is not None and abs(fix.speed_mps) > (
            STILL_M / stood_s + self._sigmas * SPEED_STD_MPS + self._a * stood_s
        ):
            return True
        if not still.before or stood_s > WINDOW_S:
            return False
        j = still.before[-1]
        for lag_s in LAGS_S:
            at = _count_until(still.before, j.t_s - lag_s, len(still.before) - 1) - 1
            if at < 0:
                break
            i = still.before[at]
            noise_m = self._sigmas * math.hypot(i.std_m, j.std_m) + self._kinks(i, j)
            speed = (abs(j.position_m - i.position_m) - noise_m) / (j.t_s - i.t_s)
            if speed - STILL_M / stood_s > self._a * (first_s + 0.5 * stood_s - 0.5 * (i.t_s + j.t_s)):
                return True
        return False

    def _steps_aside(self, j: SeenFix, k: SeenFix) -> bool:
        allowed_m = DIVERGENCE * abs(k.position_m - j.position_m) + self._sigmas * math.hypot(j.std_m, k.std_m)
        return abs(k.cross_track_m - j.cross_track_m) > allowed_m

    def _changes_speed(self, i: SeenFix, j: SeenFix, k: SeenFix) -> bool:
        ij, jk = j.t_s - i.t_s, k.t_s - j.t_s
        change = abs((k.position_m - j.position_m) / jk - (j.position_m - i.position_m) / ij)
        noise = math.hypot(i.std_m / ij, j.std_m * (1.0 / ij + 1.0 / jk), k.std_m / jk)
        allowed = 0.5 * self._a * (ij + jk) + self._sigmas * noise
        # the line's kinks are looked up only where they matter
        return change > allowed and change > allowed + self._kinks(i, j) / ij + self._kinks(j, k) / jk

    def _denies_own_speed(self, run: Run, fix: SeenFix) -> bool:
        later, way_m, slack_m = fix, 0.0, 0.0
        for earlier in reversed(run):
            if later.speed_mps is None or earlier.speed_mps is None or fix.t_s - earlier.t_s > LAGS_S[-1] + STAMP_S:
                break
            dt = later.t_s - earlier.t_s
            if abs(later.speed_mps - earlier.speed_mps) > self._a * dt + self._sigmas * math.sqrt(2.0) * SPEED_STD_MPS:
                return True
            # the trapezoid errs by at most a dt²/4
            way_m += 0.5 * (later.speed_mps + earlier.speed_mps) * dt
            slack_m += (0.25 * self._a * dt + self._sigmas * SPEED_STD_MPS) * dt
            off_m = abs(fix.position_m - earlier.position_m - way_m)
            allowed_m = slack_m + self._sigmas * math.hypot(earlier.std_m, fix.std_m)
            if off_m > allowed_m and off_m > allowed_m + self._kinks(earlier, fix):
                return True
            later = earlier
        return False

    def _kinks(self, a: SeenFix, b: SeenFix) -> float:
        return max(abs(a.cross_track_m), abs(b.cross_track_m)) * self._turning(a.position_m, b.position_m)


def _distance_m(a: SeenFix, b: SeenFix) -> float:
    """The larger of the distances along and across the track."""
    return max(abs(b.position_m - a.position_m), abs(b.cross_track_m - a.cross_track_m))


def _count_until(run: Run, t_s: float, end: int) -> int:
    """How many of the first `end` fixes are not later than a time."""
    return bisect_right(run, t_s + STAMP_S, 0, end, key=_time)


def _time(fix: SeenFix) -> float:
    return fix.t_s
