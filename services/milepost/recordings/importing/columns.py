"""Which column of a log is which field, and in which unit: guessed from names and values, or as somebody says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..options import nearest
from ..units import UNITS, factor
from .fields import FIELDS, SEVERAL, WHEELS, Field
from .log_file import LogFile
from .names import SPELLINGS, as_unit, unit_in, words_of
from .solutions import Meaning, meaning_of
from .times import CLOCK, FITTING_PART, TimeFormat, time_format

ASSUMED = ", unit assumed"
# of positive and of negative numbers
HEMISPHERES = {"latitude": "NS", "longitude": "EW"}
# a column of this name says where the train goes, not where it is
TRAVEL = {"dir", "direction", "heading", "travel", "course", "richtung", "bound"}
ALIASES = {"lat": "latitude", "lon": "longitude", "altitude": "height", "quality": "solution", "odometer": "wheel"}


@dataclass(frozen=True)
class Column:
    """A column and what it is; `why`: from which sign. `meaning`: of its words. `time`: how times are written.

    `date`: the column of the date beside one of the time of day. `ahead_s`: what is added to its times, to be on the clock of
    other logs.
    """

    field: str
    name: str
    unit: str
    why: str
    meaning: Meaning | None = None
    time: TimeFormat | None = None
    date: str = ""
    ahead_s: float = 0.0

    @property
    def factor(self) -> float:
        """What its numbers are multiplied with to be SI units, or degrees."""
        if FIELDS[self.field].quantity == "angle":
            return factor(self.unit, "x_deg")
        return UNITS[self.unit].factor


@dataclass(frozen=True)
class LogColumns:
    """A log and its known columns."""

    log: LogFile
    columns: list[Column]

    def of(self, *fields: str) -> list[Column]:
        """The columns of some fields, `time` among them."""
        return [column for column in self.columns if column.field in ("time", *fields)]


@dataclass(frozen=True)
class Said:
    """What somebody says of columns: field → columns (an empty name: there is none), field → unit."""

    columns: Mapping[str, Sequence[str]]
    units: Mapping[str, str]


def said(columns: Sequence[str], units: Sequence[str]) -> Said:
    """The options `FIELD=COLUMN` and `FIELD=UNIT`. Raises ValueError."""
    named: dict[str, list[str]] = {}
    for field, column in map(_pair, columns):
        if named.get(field) and field not in SEVERAL:
            raise ValueError(f"--column {field}: given twice")
        named.setdefault(field, []).append(column)
    measured: dict[str, str] = {}
    for field, text in map(_pair, units):
        quantity = FIELDS[field].quantity
        unit = as_unit(text, quantity)
        if unit is None:
            raise ValueError(f"--unit {field}: must be one of {', '.join(SPELLINGS[quantity])}, not {text!r}")
        measured[field] = unit
    return Said(named, measured)


def _pair(text: str) -> tuple[str, str]:
    field, sign, value = text.partition("=")
    field = ALIASES.get(field, field)
    if not sign or field not in FIELDS:
        shown = f"{text!r} is not FIELD=NAME" if not sign else f"there is no field {field!r}{nearest(field, FIELDS)}"
        raise ValueError(f"{shown}; fields: {', '.join(FIELDS)}")
    return field, value


def columns_of(log: LogFile, told: Said) -> list[Column]:
    """The columns of a log that are known. Raises ValueError for one that was named and is not as said."""
    taken: set[str] = set()
    found: list[Column] = []
    for field in FIELDS.values():
        names = [name for name in told.columns.get(field.name, ()) if name in log.header]
        if field.name in told.columns:
            chosen = [_given(log, field, name, told) for name in names]
        else:
            free = [name for name in log.header if name and name not in taken]
            chosen = _guessed(log, field, free, told)
        taken |= {column.name for column in chosen} | {column.date for column in chosen}
        found += chosen
    _refuse_hemispheres(log, found)
    return found


def _refuse_hemispheres(log: LogFile, found: Sequence[Column]) -> None:
    """Raises ValueError where the sign of a place stands in a column of its own: without it the place would be mirrored."""
    for column in found:
        letters = HEMISPHERES.get(column.field)
        numbers = [number for text in log.values(column.name) if not math.isnan(number := log.number(text))]
        if letters is None or min(numbers, default=-1.0) < 0.0:
            continue
        for name in log.header:
            values = {text.strip().upper() for text in log.values(name)} if name != column.name else set()
            # a train that goes north and south is in both hemispheres only at the equator
            travel = set(words_of(name)) & TRAVEL or ({*letters} <= values and min(numbers) * column.factor > 1.0)
            if letters[1] in values and values <= {*letters, ""} and not travel:
                told = f"{column.field}: the column {name} says {letters[1]}, which is not read"
                raise ValueError(f"{told}: write {letters[1]} as a minus in {column.name}")


def _given(log: LogFile, field: Field, name: str, told: Said) -> Column:
    column = _as_column(log, field, name, told, "given")
    if column is None:
        shown = ", ".join(log.values(name)[:3])
        raise ValueError(f"{field.name}: the column {name} does not hold it: {shown or 'it is empty'}")
    return column


def _guessed(log: LogFile, field: Field, names: Sequence[str], told: Said) -> list[Column]:
    """The best fitting column, or all where there may be several."""
    ranked = sorted((rank, at) for at, name in enumerate(names) if (rank := _rank(log, field, name)) is not None)
    fitting = [column for _, at in ranked if (column := _as_column(log, field, names[at], told, "by name")) is not None]
    if field.name == "wheel":
        return [column for column in fitting if unit_in(words_of(column.name), "speed")[0] or "speed" in words_of(column.name)]
    return fitting[:1]


def misfit(log: LogFile, field: str) -> str | None:
    """The column whose name fits a field best, where its values do not; None where no name fits."""
    ranked = sorted((rank, at) for at, name in enumerate(log.header) if (rank := _rank(log, FIELDS[field], name)) is not None)
    return log.header[ranked[0][1]] if ranked else None


def _rank(log: LogFile, field: Field, name: str) -> int | None:
    """How well a name fits, 0 best; None where it does not."""
    words = words_of(name)
    own = words[: len(words) - unit_in(words, field.quantity)[1]]
    beside = {*own, *words_of(log.path.stem)} if field.name == "wheel" else set(own)
    if set(own) & field.never or (field.beside and not beside & field.beside):
        return None
    joined = "".join(own)
    ranks = [rank for rank, word in enumerate(field.words) if word in own or word == joined]
    if not ranks and field.name == "wheel" and unit_in(words, "speed")[0] and set(words_of(log.path.stem)) & WHEELS:
        return len(field.words)
    return min(ranks, default=None)


def _as_column(log: LogFile, field: Field, name: str, told: Said, why: str) -> Column | None:
    """A column as a field; None where its values do not fit."""
    texts = log.values(name)
    named = unit_in(words_of(name), field.quantity)[0]
    unit = told.units.get(field.name) or named or field.unit
    if field.name == "time":
        return _time(log, name, texts, told.units.get("time") or named, why)
    if field.name == "solution":
        meaning = meaning_of(name, log.header, texts) if texts else None
        return None if meaning is None else Column(field.name, name, "", f"{why}, {meaning.name}", meaning)
    numbers = [log.number(text) for text in texts]
    ratio = UNITS[unit].factor / UNITS[field.unit].factor
    fitting = [value for value in numbers if not math.isnan(value) and field.least <= value * ratio <= field.most]
    if not texts or len(fitting) < FITTING_PART * len(numbers):
        return None
    sure = field.name in told.units or named is not None or field.unit == "1" or field.quantity == "angle"
    return Column(field.name, name, unit, why if sure else f"{why}{ASSUMED}")


def _time(log: LogFile, name: str, texts: Sequence[str], named: str | None, why: str) -> Column | None:
    form = time_format(texts, named)
    if form is None:
        return None
    if form.unit == CLOCK:
        date = next((each for each in log.header if set(words_of(each)) & {"date", "datum", "day"} and each != name), "")
        joined = (
            time_format([f"{day} {time}" for day, time in zip(log.values(date), texts, strict=False)], None) if date else None
        )
        if joined is not None:
            return Column("time", name, joined.unit, f"{why}, with {date}", time=joined, date=date)
    elif len(set(texts)) < 2 and len(log.sample) > 1:
        return None  # a date alone, the same in all rows
    return Column("time", name, form.unit, f"{why}{ASSUMED}" if form.assumed else why, time=form)
