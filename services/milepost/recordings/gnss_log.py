"""A log of GNSS fixes as a list."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

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
