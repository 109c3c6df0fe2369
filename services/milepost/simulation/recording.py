"""Recordings: a log of GNSS fixes as a list, and the motion that its trustworthy fixes show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Array
from milepost.estimation.motion import process_noise, transition
from milepost.estimation.track import Track

from .motion import KnotMotion
from .table import Cell, degrees, read_table, utc_seconds

# how receivers name their solutions in a log, and what each means
SOLUTIONS = {
    "NARROW_INT": "rtk_fixed",
    "WIDE_INT": "rtk_fixed",
    "NARROW_FLOAT": "rtk_float",
    "L1_FLOAT": "rtk_float",
    "PSRDIFF": "differential",
    "SINGLE": "single",
    "PROPAGATED": "propagated",
}


@dataclass(frozen=True, slots=True)
class RecordedFix:
    """One row of a GNSS log; `t_s` counts from the first row."""

    t_s: float
    latitude_deg: float
    longitude_deg: float
    solution: str


def solution(position_type: str) -> str:
    """What a receiver's word for its solution means; `none` for words that nobody knows."""
    return next((meaning for prefix, meaning in SOLUTIONS.items() if position_type.startswith(prefix)), "none")


# what the logs of this form say, and where
GNSS_LOG: dict[str, Cell] = {
    "t_s": Cell("time_utc", utc_seconds),
    "latitude_deg": Cell("latitude_deg", lambda text: degrees(text, 90.0)),
    "longitude_deg": Cell("longitude_deg", lambda text: degrees(text, 180.0)),
    "solution": Cell("position_type", solution),
}


def read_gnss_log(path: Path) -> list[RecordedFix]:
    """The fixes of a log, in order of time.

    Columns: `time_utc` (ISO 8601), `latitude_deg`, `longitude_deg`, `position_type`. Raises ValueError naming file, line
    and column for what it cannot read.
    """
    fixes: list[RecordedFix] = []
    start: float | None = None
    for row in read_table(path, GNSS_LOG):
        if row.error is not None:
            raise ValueError(f"{path}: {row.error}")
        t = row.values.pop("t_s")
        start = t if start is None else start
        # the receiver stamps on a grid of tenths; ISO text carries them to the millisecond
        fixes.append(RecordedFix(round(t - start, 3), **row.values))
    if len(fixes) < 2:
        raise ValueError(f"{path}: fewer than two fixes")
    return sorted(fixes, key=lambda fix: fix.t_s)


def smooth_motion(fixes: Sequence[RecordedFix], track: Track, fix_std_m: float, jerk_psd: float) -> KnotMotion:
    """The motion that a log's RTK-fixed positions show: a Rauch-Tung-Striebel smoother over their chainages.

    Forward: the Kalman filter of `estimation.kalman` with z = chainage, R = `fix_std_m`². Backward, from the last fix:
    C = P_k Fᵀ P̄_{k+1}⁻¹, x_k ← x_k + C (x_{k+1} - x̄_{k+1}). Gaps in the fixes are bridged by the quintic between their ends.
    Raises ValueError with fewer than four such fixes. Source: Rauch, Tung and Striebel, AIAA J. 3(8), 1965.
    """
    # a log may say the same time twice; between two knots there must be time
    good = list({fix.t_s: fix for fix in fixes if fix.solution == "rtk_fixed"}.values())
    if len(good) < 4:
        raise ValueError("fewer than four RTK-fixed positions: they show no motion")
    times = np.array([fix.t_s for fix in good])
    chainage = np.array([track.project(fix.latitude_deg, fix.longitude_deg).position_m for fix in good])
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
    # before the first trustworthy fix the train is carried back at its first speed, so that time starts at 0
    if times[0] > 0.0:
        s, v, a = knots[0]
        t = -times[0]
        knots = np.vstack([[s + v * t + 0.5 * a * t * t, v + a * t, a], knots])
        times = np.concatenate([[0.0], times])
    return KnotMotion(times, knots)


ECEF_POSITION: dict[str, Cell] = {name: Cell(name, float) for name in ("ecef_x_m", "ecef_y_m", "ecef_z_m")}
ECEF_VELOCITY: dict[str, Cell] = {name: Cell(name, float) for name in ("ecef_vx_mps", "ecef_vy_mps", "ecef_vz_mps")}
ECEF_PATH: dict[str, Cell] = {"t_s": Cell("t_s", float), **ECEF_POSITION, **ECEF_VELOCITY}


def path_motion(path: Path, track: Track) -> KnotMotion:
    """The motion along a track of a path recorded in earth-centred metres and metres a second, from its first row on.

    Position: the chainage of the nearest point; speed: the velocity's size, both made to agree; acceleration: central
    differences of the speed. Raises ValueError naming file, line and column for what it cannot read.
    """
    import pyproj  # slow to import, and few recordings need it

    rows = []
    for row in read_table(path, ECEF_PATH):
        if row.error is not None:
            raise ValueError(f"{path}: {row.error}")
        rows.append([row.values[name] for name in ECEF_PATH])
    table = np.array(rows, dtype=float)
    if len(table) < 4 or not np.all(np.diff(table[:, 0]) > 0.0):
        raise ValueError(f"{path}: four rows at least, at increasing times, are needed")
    times = table[:, 0] - table[0, 0]
    longitude, latitude, _ = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*table[:, 1:4].T)
    s = np.array([track.project(lat, lon).position_m for lat, lon in zip(latitude, longitude, strict=True)])
    return KnotMotion(times, _smooth(times, s, np.linalg.norm(table[:, 4:7], axis=1)))


def _smooth(times: Array, s: Array, v: Array) -> Array:
    """[s, v, a] (n, 3) of which each is the other's derivative: s = p + d, p = ∫v dt, d the mean of s - p over ±1 s.

    Positions and speeds of a recording are not quite each other's; as knots, they would be joined by jumps of acceleration.
    """
    p = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(times))])
    reach = max(1, round(1.0 / float(np.median(np.diff(times)))))
    window = np.ones(2 * reach + 1)
    # beyond the ends the difference is held
    d = np.convolve(np.pad(s - p, reach, mode="edge"), window / window.sum(), mode="valid")
    v = v + np.gradient(d, times)
    return np.column_stack([p + d, v, np.gradient(v, times)])
