"""The recording of a receiver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .columns import Column
from .log_file import LogFile
from .rows import Array, Rows, shifted, within
from .source import COPIED_TIME, Copy, Recording, Span, cell, own_time, reasons

# of a fix with a radial figure, each of two axes has this much
ONE_AXIS = 1.0 / math.sqrt(2.0)
LEAST_STD_M = 1e-6


class Written(NamedTuple):
    """How a field stands in a message and in a copy: name, unit, digits."""

    name: str
    unit: str
    digits: int


FIELDS = {
    "latitude": Written("latitude_deg", "deg", 9),
    "longitude": Written("longitude_deg", "deg", 9),
    "solution": Written("solution", "", 0),
    "height": Written("altitude_m", "m", 3),
    "speed": Written("speed_mps", "m/s", 4),
    "course": Written("course_deg", "deg", 3),
    "accuracy": Written("horizontal_std_m", "m", 4),
    "satellites": Written("satellites", "", 0),
    "hdop": Written("hdop", "", 2),
}


def position_recording(log: LogFile, columns: Sequence[Column], rows: Rows, span: Span) -> Recording:
    """The recording of the receiver whose fixes are `rows`, with a field `course` where it is computed from the places."""
    constants: dict[str, Any] = {} if any(each.field == "solution" for each in columns) else {"solution": "single"}
    why = reasons(log, columns, rows, span) + _unfit(columns, rows)
    if why:
        fields = [field for field in FIELDS if field in rows.values or (field == "solution" and not constants)]
        mapped = {FIELDS[field].name: _copied(FIELDS[field]) for field in fields}
        return Recording(log.path, COPIED_TIME, mapped, constants, _copy(rows, span, fields, "; ".join(why)))
    mapped = {FIELDS[each.field].name: _own(each, rows) for each in columns if each.field in FIELDS}
    return Recording(log.path, own_time(columns, span), mapped, constants, None)


def _unfit(columns: Sequence[Column], rows: Rows) -> list[str]:
    """What a message cannot say as the log says it."""
    why = []
    course, accuracy = rows.values.get("course"), rows.values.get("accuracy")
    if course is not None and not any(each.field == "course" for each in columns):
        why.append("courses computed from the places")
    elif course is not None and bool(np.any((course < 0.0) | (course > 360.0))):
        why.append("courses below 0 or above 360 degrees")
    if accuracy is not None and bool(np.any(accuracy < LEAST_STD_M)):
        why.append("accuracies of 0")
    return why


def _own(column: Column, rows: Rows) -> dict[str, Any]:
    entry: dict[str, Any] = {"column": column.name}
    if column.field == "solution":
        return entry | {"values": {word: meant for word, meant in rows.words.items() if word and word != "*"} | {"*": "none"}}
    if FIELDS[column.field].unit:
        entry["unit"] = column.unit
    return entry | ({"scale": round(ONE_AXIS, 4)} if column.field == "accuracy" else {})


def _copied(written: Written) -> dict[str, Any]:
    return {"column": written.name} | ({"unit": written.unit} if written.unit else {})


def _copy(rows: Rows, span: Span, fields: Sequence[str], why: str) -> Copy:
    used = shifted(within(rows, span.from_s, span.to_s), span.from_s)
    scaled: dict[str, Array] = dict(used.values)
    if "accuracy" in scaled:
        scaled["accuracy"] = np.where(scaled["accuracy"] >= LEAST_STD_M, scaled["accuracy"] * ONE_AXIS, math.nan)
    if "course" in scaled:
        scaled["course"] = scaled["course"] % 360.0
    written = [
        used.solution if field == "solution" else [cell(value, FIELDS[field].digits) for value in scaled[field].tolist()]
        for field in fields
    ]
    times = [cell(t, 4) for t in used.t_s.tolist()]
    return Copy(
        "recorded-gnss.csv",
        ["t_s", *(FIELDS[field].name for field in fields)],
        [*map(list, zip(times, *written, strict=True))],
        why,
    )
