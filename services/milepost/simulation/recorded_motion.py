"""The motion from a recording: through trusted GNSS fixes, or along a recorded path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Array
from milepost.estimation.motion import process_noise, transition
from milepost.recordings.ecef_path import ECEF_PATH
from milepost.recordings.gnss_log import RecordedFix
from milepost.recordings.table import read_table
from milepost.recordings.truth_rows import TruthRow, in_order
from milepost.track.track import Track

from .motion import KnotMotion

# a chainage is ambiguous if another part of the track is at most this much farther than the nearest
AMBIGUOUS_M = 1.0
# chainages this far apart are different parts of the track
APART_M = 20.0
# within this time a train's path is at most this many times as long as its chord
STRAIGHT_S = 10.0
LONGEST_DETOUR = 1.5
DEGREE_M = 111_200.0


def smooth_motion(file: Path, fixes: Sequence[RecordedFix], track: Track, fix_std_m: float, jerk_psd: float) -> KnotMotion:
    """The motion through a log's RTK-fixed positions: a Rauch-Tung-Striebel smoother over their chainages.

    `fixes`: at increasing times, from `file`. Forward: the Kalman filter of `estimation.kalman` with z = chainage,
    R = `fix_std_m`². Backward, from the last fix: C = P_k Fᵀ P̄_{k+1}⁻¹, x_k ← x_k + C (x_{k+1} - x̄_{k+1}). Gaps in the fixes
    are bridged by the quintic between their ends. Raises ValueError with fewer than four such fixes, and as `chainages`
    does. Source: Rauch, Tung and Striebel, AIAA J. 3(8), 1965.
    """
    good = [fix for fix in fixes if fix.solution == "rtk_fixed"]
    if len(good) < 4:
        raise ValueError(f"{file}: fewer than four RTK-fixed positions")
    times = np.array([fix.t_s for fix in good])
    rows = [TruthRow(fix.line, fix.t_s, (fix.latitude_deg, fix.longitude_deg)) for fix in good]
    chainage = chainages(file, rows, track)
    h = np.array([1.0, 0.0, 0.0])
    x = np.array([chainage[0], (chainage[3] - chainage[0]) / (times[3] - times[0]), 0.0])
    P = np.diag([1.0, 4.0, 1.0])
    before: list[tuple[Array, Array, Array]] = []
    after: list[tuple[Array, Array]] = []
    for k, z in enumerate(chainage):
        F = np.eye(3)
        if k:
            dt = float(times[k] - times[k - 1])
            F = transition(dt)
            x, P = predict(x, P, F, process_noise(dt, jerk_psd))
        before.append((x, P, F))
        x, P = update(x, P, h, float(z), fix_std_m**2)
        after.append((x, P))
    smooth = [after[-1][0]]
    for k in range(len(after) - 2, -1, -1):
        x_bar, P_bar, F = before[k + 1]
        C = np.linalg.solve(P_bar, F @ after[k][1]).T
        smooth.append(after[k][0] + C @ (smooth[-1] - x_bar))
    knots = np.array(smooth[::-1])
    # the motion is extrapolated backwards from the first trusted fix, so that it begins at time 0
    if times[0] > 0.0:
        s, v, a = knots[0]
        t = -times[0]
        knots = np.vstack([[s + v * t + 0.5 * a * t * t, v + a * t, a], knots])
        times = np.concatenate([[0.0], times])
    return KnotMotion(times, knots)


def path_motion(file: Path, track: Track) -> KnotMotion:
    """The motion along a track of a path recorded in earth-centred metres and metres a second, from its first row on.

    Position: the chainage of the nearest point; speed: the velocity's size, both made to agree; acceleration: central
    differences of the speed. Raises ValueError naming file, line and column for what it cannot read, and as
    `truth_rows.in_order` and `chainages` do.
    """
    import pyproj  # slow to import, and few recordings need it

    rows: list[TruthRow] = []
    for line, values, error in read_table(file, ECEF_PATH):
        if error is not None:
            raise ValueError(f"{file}: {error}")
        t_s, *place = (values[name] for name in ECEF_PATH)
        rows.append(TruthRow(line, t_s, tuple(place)))
    rows = in_order(file, rows)
    if len(rows) < 4:
        raise ValueError(f"{file}: fewer than four rows")
    table = np.array([row.place for row in rows])
    longitude, latitude, _ = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*table[:, :3].T)
    placed = [row._replace(place=at) for row, at in zip(rows, zip(latitude, longitude, strict=True), strict=True)]
    times = np.array([row.t_s for row in rows])
    times = times - times[0]
    return KnotMotion(times, _smooth(times, chainages(file, placed, track), np.linalg.norm(table[:, 3:6], axis=1)))


def chainages(file: Path, rows: Sequence[TruthRow], track: Track) -> Array:
    """The chainage of each row's (latitude_deg, longitude_deg): that of the nearest point of the track.

    Raises ValueError naming file, line and time of a row whose chainage is ambiguous, because another part of the track is
    as near, and of one to which the chainage jumps although the position does not.
    """
    s = np.array([_chainage(file, row, track) for row in rows])
    places, times = np.array([row.place for row in rows]), np.array([row.t_s for row in rows])
    moved, along = np.hypot(*np.diff(_Plane(*places.mean(axis=0)).of(places), axis=0).T), np.abs(np.diff(s))
    jumps = (along > LONGEST_DETOUR * moved + APART_M) & (np.diff(times) <= STRAIGHT_S)
    for k in np.flatnonzero(jumps).tolist():
        text = f"the chainage jumps from {s[k]:.0f} m to {s[k + 1]:.0f} m, the position moves by {moved[k]:.1f} m"
        raise ValueError(f"{rows[k + 1].named(file)}: {text}")
    return s


def _chainage(file: Path, row: TruthRow, track: Track) -> float:
    latitude, longitude = row.place
    nearest = track.project(latitude, longitude)
    off = abs(nearest.cross_track_m)
    # the farther the point is from the track, the longer is the part of the track at about the same distance
    legs = track.legs(latitude, longitude, off + AMBIGUOUS_M, APART_M + 2.0 * off)
    if len(legs) > 1:
        where = f"{legs[0].position_m:.0f} m and {legs[1].position_m:.0f} m of the line are equally near"
        raise ValueError(f"{row.named(file)}: the chainage is ambiguous: {where}")
    return nearest.position_m


class _Plane:
    """Metres east and north of a point, to a percent within a degree of latitude: enough to find near points."""

    def __init__(self, latitude_deg: float, longitude_deg: float) -> None:
        self._origin = np.array([latitude_deg, longitude_deg])
        self._metres = DEGREE_M * np.array([1.0, np.cos(np.radians(latitude_deg))])

    def of(self, places: Array) -> Array:
        """(n, 2) of latitude and longitude in degrees, as metres."""
        out: Array = (places - self._origin) * self._metres
        return out


def _smooth(times: Array, s: Array, v: Array) -> Array:
    """[s, v, a] (n, 3) of which each is the other's derivative: s = p + d, p = ∫v dt, d the mean of s - p over ±1 s.

    Recorded positions and speeds do not quite agree; as knots, they would give jumps of acceleration.
    """
    p = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(times))])
    reach = max(1, round(1.0 / float(np.median(np.diff(times)))))
    window = np.ones(2 * reach + 1)
    # beyond the ends the difference is held
    d = np.convolve(np.pad(s - p, reach, mode="edge"), window / window.sum(), mode="valid")
    v = v + np.gradient(d, times)
    return np.column_stack([p + d, v, np.gradient(v, times)])
