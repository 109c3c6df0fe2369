"""The line of an imported train, and where its fixes lie on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from milepost.recordings.importing.rows import Array, Rows
from milepost.recordings.importing.source import Span
from milepost.recordings.units import METRES_PER_DEGREE
from milepost.track.from_fixes import noise_of, path_through
from milepost.track.track import Track

from ..line_file import load_line
from ..yaml_files import ConfigError

# with a line of somebody's own, so many of the fixes must lie so near to it
NEAR_M, NEAR_PART = 50.0, 0.5
MOST_PROJECTED = 5000
GAP_TOLD_M = 100.0


@dataclass(frozen=True)
class Way:
    """A line with the fixes on it. `points`: of a line that was made, None for a given one.

    `t_s`, `position_m` (n): good fixes of the span, from its beginning, and their chainage; `off_m`: the rms of their distance
    from the line; `noise_m`: of one axis, from fix to fix; `told`: what a reader should know of it.
    """

    points: list[tuple[float, float]] | None
    length_m: float
    span: Span
    t_s: Array
    position_m: Array
    off_m: float
    noise_m: float
    told: list[str]


def way_of(rows: Rows, good: Rows, line: Path | None) -> Way:
    """The way of a train: `rows` are all its fixes, `good` those that count. Raises ValueError and ConfigError."""
    latitude, longitude = good.values["latitude"], good.values["longitude"]
    if line is not None:
        return _on_a_given(rows, good, line)
    path = path_through(good.t_s, latitude, longitude)
    whole = path.parts == 1
    from_s, to_s = (rows.t_s[0], rows.t_s[-1]) if whole else (good.t_s[path.first], good.t_s[path.last])
    span = Span(float(from_s), float(to_s), whole)
    told = []
    if not whole:
        told.append(
            f"the track comes back to where it was, in {path.parts} parts of {path.whole_m:.0f} m in all: the longest is used, "
            f"{path.length_m:.0f} m from {span.from_s - rows.t_s[0]:.0f} to {span.to_s - rows.t_s[0]:.0f} s of the log"
        )
    if path.gap_m > GAP_TOLD_M:
        told.append(
            f"the line is straight for {path.gap_m:.0f} m where no good fix is; a line file of your own (--line) knows more"
        )
    t_s, position_m, off_m = _projected(Track(path.points), good, span)
    return Way(path.points, path.length_m, span, t_s, position_m, off_m, path.noise_m, told)


def _on_a_given(rows: Rows, good: Rows, line: Path) -> Way:
    known = load_line(line)
    if known.track is None:
        raise ConfigError(line, "geojson", "needed, to place fixes on the line")
    span = Span(float(rows.t_s[0]), float(rows.t_s[-1]), True)
    t_s, position_m, off_m = _projected(known.track, good, span)
    scale = np.array([METRES_PER_DEGREE, METRES_PER_DEGREE * np.cos(np.radians(good.values["latitude"].mean()))])
    noise_m = noise_of(np.column_stack([good.values["latitude"], good.values["longitude"]]) * scale)
    return Way(None, known.length_m, span, t_s, position_m, off_m, noise_m, [])


def _projected(track: Track, good: Rows, span: Span) -> tuple[Array, Array, float]:
    inside = np.flatnonzero((good.t_s >= span.from_s) & (good.t_s <= span.to_s))
    inside = inside[:: max(1, len(inside) // MOST_PROJECTED)]
    places = zip(good.values["latitude"][inside].tolist(), good.values["longitude"][inside].tolist(), strict=True)
    found = [track.project(*place) for place in places]
    off = np.abs(np.array([each.cross_track_m for each in found]))
    if np.count_nonzero(off <= NEAR_M) < NEAR_PART * len(off):
        raise ValueError(f"half of the fixes lie {np.median(off):.0f} m or more from the line")
    return good.t_s[inside] - span.from_s, np.array([each.position_m for each in found]), float(np.sqrt(np.mean(off * off)))
