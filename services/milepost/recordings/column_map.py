"""A CSV log as readings of any kind of sensor, by the column map of the train file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from milepost_schemas import Message

from .column_options import ColumnOptions, RecordingOptions
from .measured import Measured
from .table import Cell, read_table
from .units import factor, unit_of

TIME = "time"
# valid values of the fields that every message has, to check a row's own fields
HEAD: dict[str, Any] = {"train": "t", "unit": "u", "instance": "i", "sequence": 0, "measured_at_ns": 1, "published_at_ns": 1}
# the fields for the time over which a reading is a mean
INTERVALS = ("interval_s", "mean_over_s")


class Recorded(NamedTuple):
    """A reading of a recording, when its last row was there, and the line of that row in the file."""

    ready_s: float
    reading: Measured
    line: int


def check_map(options: RecordingOptions, message: type[Message]) -> None:
    """Check that a map makes valid messages. Raises ValueError for an unknown field, a missing one, and a wrong unit."""
    known = {name: field for name, field in message.model_fields.items() if name not in Message.model_fields}
    given = [*options.columns, *options.constants]
    for name in given:
        if name not in known:
            raise ValueError(f"columns.{name}: {message.SCHEMA} has no such field; it has {', '.join(known)}")
    for name, field in known.items():
        derived = name in INTERVALS and options.average_s is not None
        if field.is_required() and name not in given and not derived:
            raise ValueError(f"columns.{name}: {message.SCHEMA} needs it")
    _cells(options, message)


def _cells(options: RecordingOptions, message: type[Message]) -> dict[str, Cell]:
    cells = {TIME: Cell(options.time.column, options.time.seconds)}
    for name, columns in options.columns.items():
        field = message.model_fields[name]
        for number, column in enumerate(columns if isinstance(columns, list) else [columns]):
            try:
                read = _reader(name, column, field.annotation)
            except ValueError as error:
                raise ValueError(f"columns.{name}: {error}") from error
            key = f"{name}.{number}" if isinstance(columns, list) else name
            cells[key] = Cell(column.column, read, optional=not field.is_required())
    return cells


def _reader(name: str, column: ColumnOptions, annotation: Any) -> Callable[[str], Any]:
    if column.values is not None:
        return partial(_word, column.values)
    if _holds(annotation, float):
        if column.unit is None and unit_of(name) != "1":
            raise ValueError(f"give its unit, such as {unit_of(name)}")
        return partial(_number, factor(column.unit or "1", name) * column.scale)
    if column.unit is not None:
        raise ValueError("has no unit")
    return _count if _holds(annotation, int) else str.strip


def _holds(annotation: Any, kind: type) -> bool:
    return annotation is kind or any(_holds(inner, kind) for inner in get_args(annotation))


def _as_field(value: Any, field: FieldInfo) -> Any:
    """A constant as the field's type: 1 for a real quantity becomes 1.0, which `averaged` would else take for a count."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if whole and _holds(field.annotation, float) else value


def _word(values: Mapping[str, Any], text: str) -> Any:
    word = text.strip()
    if word in values:
        return values[word]
    begins = [key for key in values if key.endswith("*") and word.startswith(key[:-1])]
    if not begins:
        raise ValueError(f"must be one of {', '.join(values)}, not {word!r}")
    return values[max(begins, key=len)]


def _number(scale: float, text: str) -> float:
    value = float(text) * scale
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite")
    return value


def _count(text: str) -> int:
    value = float(text)
    if not math.isfinite(value) or value != int(value):
        raise ValueError(f"{text} is not a whole number")
    return int(value)


def time_zero_s(options: RecordingOptions) -> float:
    """The time in the time column at scenario time 0, in seconds. Raises ValueError and OSError for a file without one."""
    if options.time.zero_s is not None:
        return options.time.zero_s
    first = next(read_table(options.file, {TIME: Cell(options.time.column, options.time.seconds)}), None)
    if first is None or first.error is not None:
        raise ValueError(f"{options.file}: {'no row' if first is None else first.error}")
    zero_s: float = first.values[TIME]
    return zero_s


class ColumnMap:
    """The rows of a recording as readings, on scenario time. Raises ValueError as `check_map` does."""

    def __init__(self, options: RecordingOptions, message: type[Message]) -> None:
        check_map(options, message)
        self._options, self._message = options, message
        self._cells = _cells(options, message)
        self._constants = {name: _as_field(value, message.model_fields[name]) for name, value in options.constants.items()}
        self._vectors = {name: len(columns) for name, columns in options.columns.items() if isinstance(columns, list)}
        self._intervals = [name for name in INTERVALS if name in message.model_fields and name not in options.columns]

    def rows(self) -> Iterator[Recorded]:
        """Every row in the order of the file. Raises ValueError naming file, line and column."""
        time = self._options.time
        zero_s = time.zero_s
        for line, values, error in read_table(self._options.file, self._cells):
            if error is not None:
                raise ValueError(f"{self._options.file}: {error}")
            stamp = values.pop(TIME)
            zero_s = stamp if zero_s is None else zero_s
            # times since 1970 are good to a quarter of a microsecond
            at = round(stamp - zero_s + self._options.shift_s, 6)
            yield Recorded(at, Measured(at, self._fields(values)), line)

    def check(self, reading: Measured, place: str) -> None:
        """Check that a reading makes a valid message. Raises ValueError naming file, `place` and field."""
        try:
            self._message(**HEAD, **reading.fields)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(str(part) for part in first["loc"])
            text = first["msg"].removeprefix("Value error, ")
            raise ValueError(f"{self._options.file}: {place}: {field}{': ' if field else ''}{text}") from error

    def averaged(self, rows: Iterable[Recorded]) -> Iterator[Recorded]:
        """Rows, which must be in order of time, as means over `average_s`; as they are where there is none."""
        average_s = self._options.average_s
        if average_s is None:
            yield from rows
            return
        # a row on the boundary belongs to the window that it ends
        for _, window in groupby(rows, lambda row: math.ceil(row.ready_s / average_s - 1e-9)):
            yield self._mean(list(window), average_s)

    def _fields(self, values: dict[str, Any]) -> dict[str, Any]:
        for name, size in self._vectors.items():
            parts = [values.pop(f"{name}.{number}") for number in range(size)]
            values[name] = None if None in parts else parts
        return self._constants | {name: value for name, value in values.items() if value is not None}

    def _mean(self, rows: list[Recorded], average_s: float) -> Recorded:
        """The mean of the rows of one window, true at the mean of their times where the quantity changes evenly.

        Of white errors the variance of the mean is 1/n of a row's, and a standard deviation 1/√n of it.
        """
        readings, last = [row.reading for row in rows], rows[-1]
        fields: dict[str, Any] = {}
        for name in last.reading.fields:
            fields[name] = _mean_of(name, [reading.fields[name] for reading in readings if name in reading.fields])
        fields |= dict.fromkeys(self._intervals, average_s)
        measured_s = sum(reading.measured_s for reading in readings) / len(readings)
        return Recorded(last.ready_s, Measured(measured_s, fields), last.line)


class CsvSource:
    """The readings of a recording from scenario time `from_s` on, at their own pace, read as they are needed.

    A row that is not after the one before is skipped: `skipped` counts them, and `told` has the place of the first.
    The whole file is checked first. Raises ValueError naming file, line and column for a row that cannot be read, and
    naming the field for a first reading that is not a valid message.
    """

    def __init__(self, options: RecordingOptions, message: type[Message], from_s: float) -> None:
        self._file, self._column = options.file, options.time.column
        self.skipped: dict[str, int] = {}
        self.told: dict[str, str] = {}
        table = ColumnMap(options, message)
        if sum(1 for _ in table.rows()) < 1:
            raise ValueError(f"{options.file}: no row")
        readings = table.averaged(self._in_order(table.rows()))
        self._readings = (recorded for recorded in readings if recorded.reading.measured_s >= max(from_s, 0.0))
        self._next = next(self._readings, None)
        if self._next is not None:
            table.check(self._next.reading, "the first reading")

    def next_s(self) -> float | None:
        """The time at which the next reading is ready; None after the last."""
        return None if self._next is None else self._next.ready_s

    def read(self) -> Measured | None:
        """The next reading."""
        recorded, self._next = self._next, next(self._readings, None)
        return None if recorded is None else recorded.reading

    def _in_order(self, rows: Iterable[Recorded]) -> Iterator[Recorded]:
        last_s = -math.inf
        for row in rows:
            if row.ready_s > last_s:
                last_s = row.ready_s
                yield row
                continue
            self.skipped["out_of_order"] = self.skipped.get("out_of_order", 0) + 1
            self.told.setdefault("out_of_order", f"{self._file}: line {row.line}: {self._column}: not after the row before")


def _mean_of(name: str, values: list[Any]) -> Any:
    last, n = values[-1], len(values)
    if isinstance(last, list):
        return [sum(column) / n for column in zip(*values, strict=True)]
    if not isinstance(last, float):
        return last
    if name == "course_deg":
        return math.degrees(math.atan2(*(sum(f(math.radians(a)) for a in values) for f in (math.sin, math.cos)))) % 360.0
    mean = sum(values) / n
    if "variance" in name.split("_"):
        return mean / n
    return mean / math.sqrt(n) if "std" in name.split("_") else mean
