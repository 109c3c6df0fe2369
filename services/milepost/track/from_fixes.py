"""A line made from the track that a receiver saw: a smooth path through its fixes, until it comes back to itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# of a normal distribution: standard deviation over median absolute value
MAD = 1.4826
# second differences of white noise have six times its variance
SECOND_DIFFERENCE = math.sqrt(6.0)
MOST_NOISE_M = 5.0
# no train moves faster, and a fix that would need it is none; slower than this it stands, and its fixes only wander
FASTEST_MPS, STANDING_MPS = 150.0, 0.7
STANDING_OVER_S = 10.0
STEP_M = 5.0
# the path is a parabola over this much either way, and over so many points: the transition to a curve is longer
REACH_M, LEAST_POINTS = 20.0, 7
# a way without fixes that is so many times the usual one is a gap
LONG_GAP = 4.0
# parts of the path that are this near, and this many times as far from each other along it, are the same place again
NEAR_M, APART = 10.0, 6.0


class NoWayError(ValueError):
    """The fixes are no way of a train."""


@dataclass(frozen=True)
class Path:
    """A path: points (longitude_deg, latitude_deg), and of which fixes it is made.

    `first`, `last`: indices of the fixes at its ends. `parts`: in how many parts the whole way falls, of which this is the
    longest; `whole_m`: how long all are together. `gap_m`: the longest way without fixes. `noise_m`: standard deviation of
    one axis of a fix, from fix to fix.
    """

    points: list[tuple[float, float]]
    first: int
    last: int
    length_m: float
    parts: int
    whole_m: float
    gap_m: float
    noise_m: float


def path_through(t_s: Array, latitude_deg: Array, longitude_deg: Array) -> Path:
    """The path through fixes at increasing times.

    Fixes at a stop and jumps are left out, the others taken where they are a step apart; where the path comes near to where
    it was, a new part begins, and the longest is kept. Over its arc length the path is locally a parabola, fitted to the
    fixes with weights (1 - u²)²; where there are none for long it is straight.
    Raises NoWayError where there is no way of at least 50 m.
    """
    import pyproj  # slow to import

    plane = f"+proj=tmerc +ellps=WGS84 +lat_0={latitude_deg.mean()} +lon_0={longitude_deg.mean()}"
    transformer = pyproj.Transformer.from_crs("EPSG:4326", plane, always_xy=True)
    x, y = transformer.transform(longitude_deg, latitude_deg)
    place = np.column_stack([x, y])
    noise_m = noise_of(place)
    kept = _apart(t_s, place, min(max(3.0 * noise_m, 1.0), 15.0))
    if len(kept) < 4:
        far_m = float(np.hypot(*(place.max(axis=0) - place.min(axis=0))))
        raise NoWayError(f"no line can be made: the train does not move ({far_m:.0f} m in {t_s[-1] - t_s[0]:.0f} s)")
    at = place[kept]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))])
    near_m = max(NEAR_M, 4.0 * noise_m)
    cuts = _cuts(at, along, near_m)
    first, last = max(pairwise(cuts), key=lambda part: along[part[1]] - along[part[0]])
    if along[last] - along[first] < 5.0 * NEAR_M or last - first < 3:
        raise NoWayError(
            f"no line can be made: its longest way is {along[last] - along[first]:.0f} m, of {len(cuts) - 1} parts"
        )
    own = slice(first, last + 1)
    smooth = _smooth(at[own], along[own] - along[first], max(REACH_M, 8.0 * noise_m))
    longitude, latitude = transformer.transform(smooth[:, 0], smooth[:, 1], direction="INVERSE")
    points = list(zip(np.asarray(longitude).tolist(), np.asarray(latitude).tolist(), strict=True))
    gap_m = float(np.diff(along[own]).max())
    length_m = float(np.hypot(*np.diff(smooth, axis=0).T).sum())
    return Path(points, int(kept[first]), int(kept[last]), length_m, len(cuts) - 1, float(along[-1]), gap_m, noise_m)


def noise_of(place: Array) -> float:
    """The standard deviation of one axis of places (n, 2), from fix to fix."""
    if len(place) < 5:
        return 0.0
    second = np.diff(place, 2, axis=0)
    return min(MAD * float(np.median(np.abs(second))) / SECOND_DIFFERENCE, MOST_NOISE_M)


def _apart(t_s: Array, place: Array, step_m: float) -> NDArray[np.int64]:
    """The fixes of a train that moves, at least a step apart, without jumps."""
    half = 0.5 * STANDING_OVER_S
    before, after = (
        np.column_stack([np.interp(t_s + shift, t_s, place[:, axis]) for axis in (0, 1)]) for shift in (-half, half)
    )
    span = np.minimum(t_s + half, t_s[-1]) - np.maximum(t_s - half, t_s[0])
    moves = np.hypot(*(after - before).T) >= STANDING_MPS * span
    kept: list[int] = []
    for i in np.flatnonzero(moves).tolist():
        if kept:
            way, time = math.dist(place[i], place[kept[-1]]), float(t_s[i] - t_s[kept[-1]])
            if way < step_m or way > FASTEST_MPS * time:
                continue
        kept.append(i)
    return np.array(kept, dtype=np.int64)


def _cuts(at: Array, along: Array, near_m: float) -> list[int]:
    """Where parts begin and end: indices, the first and the last among them."""
    apart_m = APART * near_m
    cuts, cells = [0], dict[tuple[int, int], list[int]]()
    for i, (x, y) in enumerate(at.tolist()):
        cell = math.floor(x / near_m), math.floor(y / near_m)
        close = [
            j
            for dx in (-1, 0, 1)
            for dy in (-1, 0, 1)
            for j in cells.get((cell[0] + dx, cell[1] + dy), ())
            if along[i] - along[j] > apart_m and math.dist(at[j], (x, y)) < near_m
        ]
        if close:
            # a train that went back turned half-way between; one that came round is where it was
            back = along[i] - along[max(close)] < 2.0 * apart_m
            cut = int(np.searchsorted(along, 0.5 * (along[i] + along[max(close)]))) if back else i
            cuts.append(max(cut, cuts[-1] + 1))
            cells = {}
            for j in range(cuts[-1], i):
                cells.setdefault((math.floor(at[j, 0] / near_m), math.floor(at[j, 1] / near_m)), []).append(j)
        cells.setdefault(cell, []).append(i)
    last = len(at) - 1
    return [*(cut for cut in cuts if cut < last), last]


def _smooth(at: Array, along: Array, reach_m: float) -> Array:
    """Points (n, 2) every 5 m of arc length, each the middle of a parabola through the points around it."""
    places = np.linspace(0.0, float(along[-1]), max(2, round(float(along[-1]) / STEP_M) + 1))
    spacing = np.diff(along)
    gap_m = max(2.0 * reach_m, LONG_GAP * float(np.median(spacing)))
    few = min(LEAST_POINTS, len(at))
    out = np.column_stack([np.interp(places, along, at[:, axis]) for axis in (0, 1)])
    after = np.clip(np.searchsorted(along, places, "right"), 1, len(along) - 1)
    for k in np.flatnonzero(spacing[after - 1] < gap_m).tolist():
        away = np.abs(along - places[k])
        reach = max(reach_m, 1.01 * float(np.partition(away, few - 1)[few - 1]))
        near = away < reach
        u = (along[near] - places[k]) / reach
        weight = (1.0 - u * u)[:, None]
        terms = np.vander(u, 3, increasing=True)
        out[k] = np.linalg.lstsq(terms * weight, at[near] * weight, rcond=None)[0][0]
    return out
