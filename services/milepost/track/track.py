"""A track on the earth: a polyline on WGS84 and its chainage."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .polyline import Polyline

STEP_M = 100.0
# headings are means over ± this: longer than the points of a line lie apart, shorter than the transition to a curve
SMOOTH_M = 15
HEADING_STEP_M = 5


@dataclass(frozen=True, slots=True)
class Projection:
    """The projection of a point on the line: the nearest point's chainage and the distance from it.

    `position_m` is below 0 or above the line's length where the point lies beyond an end: the track is extended straight.
    `cross_track_m` is positive to the right, seen in the direction of increasing chainage.
    """

    position_m: float
    cross_track_m: float


class Track:
    """A polyline on WGS84, with chainage along its geodesics.

    `points`: (longitude_deg, latitude_deg) in the direction of increasing chainage, at least two. Nearest points are
    found on a transverse Mercator plane about the middle of the line and carried over to geodesic chainage vertex by
    vertex, so that the plane's scale does not enter. `length_m` is the length along the geodesics.
    Raises ValueError for fewer than two distinct points.
    """

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        # imported here because the import is slow and only lines with geometry need it
        import pyproj

        lon = np.array([p[0] for p in points], dtype=float)
        lat = np.array([p[1] for p in points], dtype=float)
        if len(points) < 2:
            raise ValueError("a track must have at least two points")
        forth, back, lengths = pyproj.Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])
        if not np.all(np.asarray(lengths) > 0.0):
            raise ValueError("neighbouring points of a track must differ")
        plane = f"+proj=tmerc +ellps=WGS84 +lat_0={lat.mean()} +lon_0={lon.mean()}"
        self._to_plane = pyproj.Transformer.from_crs("EPSG:4326", plane, always_xy=True)
        x, y = self._to_plane.transform(lon, lat)
        chainage = np.concatenate([[0.0], np.cumsum(lengths)])
        on_plane = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        self._polyline = Polyline(np.asarray(x), np.asarray(y), chainage)
        self.length_m = float(chainage[-1])
        # a geodesic's azimuth changes along it: at its middle it is half-way between those at its ends
        at_middle = np.radians(forth) + 0.5 * np.angle(np.exp(1j * (np.radians(back) + np.pi - np.radians(forth))))
        self._headings = _smooth_headings(chainage, np.unwrap(at_middle))
        # degrees between two points are not on the straight line between them: short steps keep that below 0.1 mm
        steps = [np.linspace(a, b, max(2, int((b - a) / STEP_M) + 2))[:-1] for a, b in pairwise(on_plane)]
        along = np.concatenate([*steps, on_plane[-1:]])
        lon, lat = self._to_plane.transform(np.interp(along, on_plane, x), np.interp(along, on_plane, y), direction="INVERSE")
        self._at: list[float] = np.interp(along, on_plane, chainage).tolist()
        self._lon: list[float] = np.asarray(lon).tolist()
        self._lat: list[float] = np.asarray(lat).tolist()

    def project(self, latitude_deg: float, longitude_deg: float) -> Projection:
        """The nearest point of the track; the distance is infinite for points that are not on the plane."""
        x, y = self._to_plane.transform(longitude_deg, latitude_deg)
        if not (math.isfinite(x) and math.isfinite(y)):
            return Projection(0.0, math.inf)  # a quarter of the earth away, where the plane ends
        return Projection(*self._polyline.nearest(x, y))

    def legs(self, latitude_deg: float, longitude_deg: float, within_m: float, apart_m: float) -> list[Projection]:
        """The nearest points of all parts of the track that pass within a distance, nearest first.

        Parts are distinct where their nearest points are farther than `apart_m` from each other along the track.
        """
        x, y = self._to_plane.transform(longitude_deg, latitude_deg)
        if not (math.isfinite(x) and math.isfinite(y)):
            return []
        return [Projection(*foot) for foot in self._polyline.passing(x, y, within_m, apart_m)]

    def comes_near_itself(self, within_m: float, apart_m: float) -> bool:
        """Whether points farther than `apart_m` from each other along the track are closer than `within_m`."""
        return self._polyline.comes_near_itself(within_m, apart_m)

    def turning(self, from_m: float, to_m: float) -> float:
        """The turning of the polyline between two chainages, left and right added, in radians.

        Σ 2 tan(θ/2) over its kinks θ: for a point that moves at a distance c beside it, the nearest point advances by at
        most c times this more or less.
        """
        return self._polyline.turning(from_m, to_m)

    def locate(self, position_m: float) -> tuple[float, float]:
        """Latitude and longitude, in degrees, of a chainage; those of the track's end for a chainage beyond it."""
        chainage = self._at
        i = min(max(bisect_right(chainage, position_m) - 1, 0), len(chainage) - 2)
        part = min(max((position_m - chainage[i]) / (chainage[i + 1] - chainage[i]), 0.0), 1.0)
        lat, lon = self._lat, self._lon
        return lat[i] + part * (lat[i + 1] - lat[i]), lon[i] + part * (lon[i + 1] - lon[i])

    def stretch(self, from_m: float, to_m: float) -> list[tuple[float, float]]:
        """Latitudes and longitudes, in degrees, of the track between two chainages; nothing where it lies beyond an end."""
        from_m, to_m = max(from_m, self._at[0]), min(to_m, self._at[-1])
        if from_m >= to_m:
            return []
        between = self._at[bisect_right(self._at, from_m) : bisect_left(self._at, to_m)]
        return [self.locate(position_m) for position_m in (from_m, *between, to_m)]

    def heading_deg(self, position_m: float) -> float:
        """The track's heading in the direction of chainage, clockwise from north, in [0, 360)."""
        return math.degrees(self._heading(position_m)) % 360.0

    def curvature(self, position_m: float) -> float:
        """The curvature dψ/ds in 1/m, positive to the right: a central difference of the smooth heading ψ over ±15 m."""
        from_m = min(max(position_m - SMOOTH_M, 0.0), max(self.length_m - 2.0 * SMOOTH_M, 0.0))
        to_m = min(from_m + 2.0 * SMOOTH_M, self.length_m)
        return (self._heading(to_m) - self._heading(from_m)) / (to_m - from_m)

    def _heading(self, position_m: float) -> float:
        """The smooth heading in radians, not wrapped."""
        headings = self._headings
        place = min(max(position_m, 0.0), self.length_m) / HEADING_STEP_M
        i = min(int(place), len(headings) - 2)
        return headings[i] + (place - i) * (headings[i + 1] - headings[i])


def _smooth_headings(chainage: NDArray[np.float64], headings: NDArray[np.float64]) -> list[float]:
    """Headings every 5 m, as means over ±15 m of what is linear between the legs' middles. chainage (n), headings (n-1)."""
    middles = 0.5 * (chainage[1:] + chainage[:-1])
    last = HEADING_STEP_M * math.ceil(chainage[-1] / HEADING_STEP_M)
    along = np.arange(-SMOOTH_M, last + SMOOTH_M + 1, 1.0)
    window = np.full(2 * SMOOTH_M + 1, 1.0 / (2 * SMOOTH_M + 1))
    smooth: list[float] = np.convolve(np.interp(along, middles, headings), window, mode="valid")[::HEADING_STEP_M].tolist()
    return smooth
