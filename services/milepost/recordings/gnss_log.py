"""A log of GNSS fixes as a list, read strictly, as a truth must be."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator

from milepost_schemas import PositionReading

from .column_map import ColumnMap, Recorded
from .column_options import RecordingOptions
from .truth_rows import TruthRow, in_order

# the solutions by the words of receivers
SOLUTIONS = {
    "NARROW_INT": "rtk_fixed",
    "WIDE_INT": "rtk_fixed",
    "NARROW_FLOAT": "rtk_float",
    "L1_FLOAT": "rtk_float",
    "PSRDIFF": "differential",
    "SINGLE": "single",
    "PROPAGATED": "propagated",
}
WORDS = {f"{word}*": meaning for word, meaning in SOLUTIONS.items()} | {"*": "none"}


def with_default_columns(value: object) -> object:
    """The column map of a bare path: `time_utc` (ISO 8601), `latitude_deg`, `longitude_deg`, `position_type`."""
    if not isinstance(value, str | Path):
        return value
    return {
        "file": str(value),
        "time": {"column": "time_utc", "unit": "iso8601"},
        "columns": {
            "latitude_deg": {"column": "latitude_deg", "unit": "deg"},
            "longitude_deg": {"column": "longitude_deg", "unit": "deg"},
            "solution": {"column": "position_type", "values": WORDS},
        },
    }


# a log in a configuration file: a path, or a column map
GnssLog = Annotated[RecordingOptions, BeforeValidator(with_default_columns)]


@dataclass(frozen=True, slots=True)
class RecordedFix:
    """A fix of a log, on scenario time; `line` is its line in the file, 0 for a fix that is not from a file."""

    t_s: float
    latitude_deg: float
    longitude_deg: float
    solution: str
    line: int = 0


def read_gnss_log(log: RecordingOptions, wanted: Callable[[RecordedFix], bool] | None = None) -> list[RecordedFix]:
    """The fixes of a log, or the wanted ones among them, or their means over its `average_s`, at increasing times.

    Raises ValueError naming file, line and column for what cannot be read, and as `truth_rows.in_order` does for times that
    do not increase; OSError for a file that cannot be opened.
    """
    table = ColumnMap(log, PositionReading)
    rows = list(_checked(table))
    if len(rows) < 2:
        raise ValueError(f"{log.file}: fewer than two fixes")
    chosen = [row for row in rows if wanted is None or wanted(_fix(row))]
    kept = {row.line for row in in_order(log.file, (TruthRow(row.line, row.ready_s, _place(row)) for row in chosen))}
    return [_fix(mean) for mean in table.averaged(row for row in chosen if row.line in kept)]


def _checked(table: ColumnMap) -> Iterator[Recorded]:
    for row in table.rows():
        table.check(row.reading, f"line {row.line}")
        yield row


def _place(row: Recorded) -> tuple[float, float]:
    return row.reading.fields["latitude_deg"], row.reading.fields["longitude_deg"]


def _fix(row: Recorded) -> RecordedFix:
    return RecordedFix(row.reading.measured_s, *_place(row), row.reading.fields["solution"], row.line)
