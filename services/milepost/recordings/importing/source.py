"""A unit's recording as a train file describes it: a map of the log's own columns, or of a copy where these would not do."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..units import UNITS
from .columns import Column
from .log_file import LogFile
from .rows import Rows
from .times import ISO

# rows that are left out for this reason are left out by a replay too
SKIPPED_ANYWAY = "not after the row before"
COPIED_TIME = {"column": "t_s", "zero_at": 0.0}


@dataclass(frozen=True)
class Copy:
    """A file that is written beside the train file: its name, header and rows, and why the log itself does not do."""

    name: str
    header: list[str]
    rows: list[list[str]]
    why: str

    def write(self, folder: Path) -> None:
        """Write it to a folder."""
        with (folder / self.name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([self.header, *self.rows])


@dataclass(frozen=True)
class Recording:
    """What stands under `recording` in a train file, without the file's name; `copy` where the file is a copy."""

    log: Path
    time: dict[str, Any]
    columns: dict[str, Any]
    constants: dict[str, Any]
    copy: Copy | None


@dataclass(frozen=True)
class Span:
    """The part of a log that is used, in its own seconds; `whole`: all of it."""

    from_s: float
    to_s: float
    whole: bool


def reasons(log: LogFile, columns: Sequence[Column], rows: Rows, span: Span) -> list[str]:
    """Why a column map of the log itself would not do."""
    time = next(each for each in columns if each.field == "time")
    why = list(log.oddities)
    if time.time is not None and (time.date or not time.time.direct):
        why.append("times that are neither numbers nor ISO 8601")
    why += [f"{count} rows {reason}" for reason, count in rows.left_out.items() if reason != SKIPPED_ANYWAY]
    return why + ([] if span.whole else ["a part of the log"])


def own_time(columns: Sequence[Column], span: Span) -> dict[str, Any]:
    """The time column of the log itself, with its value at scenario time 0."""
    time = next(each for each in columns if each.field == "time")
    if time.unit == ISO:
        return {
            "column": time.name,
            "unit": ISO,
            "zero_at": datetime.fromtimestamp(span.from_s - time.ahead_s, UTC).isoformat(),
        }
    unit = {} if time.unit == "s" else {"unit": time.unit}
    return {"column": time.name, **unit, "zero_at": float((span.from_s - time.ahead_s) / UNITS[time.unit].factor)}


def cell(value: float, digits: int) -> str:
    """A number without zeros at its end; nothing for NaN."""
    if math.isnan(value):
        return ""
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
