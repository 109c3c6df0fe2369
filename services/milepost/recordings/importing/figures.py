"""Figures of a train file that the log itself shows: noise, how the train is driven, which solutions count."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .legs import north_east_m
from .rows import Array, Rows
from .solutions import BEST_FIRST

# accelerations are slopes over this time; below this many rows in it they are noise
SLOPE_S, LEAST_ROWS = 4.0, 4
# the difference of mean accelerations of neighbouring spans T has the variance 2/3 q T
WHITE_JERK = 1.5
# a motion model must hold in the hard part of a run too
HARD_PART = 2.0
LEAST_JERK, MOST_JERK = 0.01, 1.0
# a solution counts for the line if so many of the fixes have it, or a better one
ENOUGH = 0.3
# a withheld span: how long with another source of speed and without, at most so much of the log, and how much of it has fixes
WITHHELD_S, WITHHELD_ALONE_S, WITHHELD_PART, WITHHELD_FIXES = 30.0, 10.0, 0.2, 0.9
LEAST_WITHHELD_S, LEAST_SPEED_MPS = 3.0, 2.0
SECOND_DIFFERENCE = 6.0
# so many fixes that are apart tell whether a receiver's course is one
LEAST_COURSES, COURSE_M = 10, 20.0


def good_solutions(solution: Sequence[str]) -> list[str]:
    """The solutions of which a line is made: the best ones that together have enough of the fixes."""
    good: list[str] = []
    for each in BEST_FIRST[:-2]:
        if each in solution:
            good.append(each)
        if good and sum(one in good for one in solution) >= ENOUGH * len(solution):
            break
    return good


def white_std(values: Array) -> float:
    """The standard deviation of what is white in evenly spaced values, by their second differences."""
    second = np.diff(values, 2)
    return math.sqrt(float(np.mean(second * second)) / SECOND_DIFFERENCE) if len(second) else 0.0


def jerk_psd(t_s: Array, speed_mps: Array) -> float:
    """The spectral density q of a white jerk that would change the acceleration as these speeds show, in m²/s⁵."""
    edges = np.arange(t_s[0], t_s[-1], SLOPE_S)
    at = np.searchsorted(t_s, edges)
    slopes = [
        float(np.polyfit(t_s[a:b] - t_s[a], speed_mps[a:b], 1)[0]) if b - a >= LEAST_ROWS else math.nan
        for a, b in zip(at[:-1].tolist(), at[1:].tolist(), strict=True)
    ]
    changes = np.diff(np.array(slopes))
    changes = changes[np.isfinite(changes)]
    if len(changes) < 3:
        return LEAST_JERK
    q = HARD_PART * WHITE_JERK * float(np.mean(changes * changes)) / SLOPE_S
    return float(f"{min(max(q, LEAST_JERK), MOST_JERK):.1g}")


def courses(rows: Rows) -> Array:
    """The course over some `COURSE_M` before and after each fix, in degrees; NaN where the train hardly moves.

    From fix to fix it would be that of their noise e over the way d between them: a speed along the line would lose
    1 - cos(e/d), which is always a loss.
    """
    latitude, longitude = rows.values["latitude"], rows.values["longitude"]
    way_m = _way_m(rows)
    # the last fix that is so far before, or the first one of all; the first one that is so far after, or the last one of all
    before = np.maximum(np.searchsorted(way_m, way_m - COURSE_M, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(way_m, way_m + COURSE_M), len(way_m) - 1)
    north, east = north_east_m(latitude[before], longitude[before], latitude[after], longitude[after])
    course = np.degrees(np.arctan2(east, north)) % 360.0
    return np.where(np.hypot(north, east) >= COURSE_M, course, math.nan)


def _way_m(rows: Rows) -> Array:
    """The way since the first fix, as the receiver's speeds say, or from fix to fix, with their noise."""
    if rows.has("speed"):
        steps_m = np.abs(np.nan_to_num(rows.values["speed"][1:])) * np.diff(rows.t_s)
    else:
        latitude, longitude = rows.values["latitude"], rows.values["longitude"]
        steps_m = np.hypot(*north_east_m(latitude[:-1], longitude[:-1], latitude[1:], longitude[1:]))
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def course_off_deg(rows: Rows) -> float | None:
    """By how much the receiver's course differs from that between its fixes, in the median; None where that cannot be told."""
    if not rows.has("course"):
        return None
    off = np.abs((rows.values["course"] - courses(rows) + 180.0) % 360.0 - 180.0)
    # neighbours share most of the way that is compared: one fix for each such way counts
    off = off[np.unique(_way_m(rows) // COURSE_M, return_index=True)[1]]
    off = off[np.isfinite(off)]
    return float(np.median(off)) if len(off) >= LEAST_COURSES else None


def withheld_span(t_s: Array, position_m: Array, every_s: float, alone: bool) -> tuple[float, float] | None:
    """A span of good fixes, of a train that moves, near the middle of the log; None where there is none.

    `t_s` (n), `position_m` (n): of the good fixes, which come every `every_s`. `alone`: nothing else tells the speed.
    """
    end_s = float(t_s[-1])
    long_s = math.floor(min(WITHHELD_ALONE_S if alone else WITHHELD_S, WITHHELD_PART * end_s))
    if long_s < LEAST_WITHHELD_S:
        return None
    begins = sorted(np.arange(math.ceil(0.2 * end_s), 0.9 * end_s - long_s).tolist(), key=lambda s: abs(s - 0.5 * end_s))
    for from_s in begins:
        a, b = np.searchsorted(t_s, [from_s, from_s + long_s])
        if b - a < WITHHELD_FIXES * long_s / every_s or b - a < 2:
            continue
        if abs(position_m[b - 1] - position_m[a]) >= LEAST_SPEED_MPS * long_s * WITHHELD_FIXES:
            return float(from_s), float(from_s + long_s)
    return None
