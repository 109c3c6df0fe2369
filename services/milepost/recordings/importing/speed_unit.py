"""The unit of a column of speeds, as the places beside it show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from ..units import UNITS
from .columns import ASSUMED, Column, LogColumns, Said, columns_of
from .legs import north_east_m
from .log_file import LogFile
from .rows import Array

# what vehicles' speeds are written in
USUAL = ("m/s", "km/h", "mph", "kn", "ft/s", "cm/s", "mm/s")
# the way is taken in legs that are long beside the noise of fixes, so many of them, in so much of a log at most
LEG_M, LEAST_LEGS, MOST_LEGS, MOST_ROWS = 20.0, 5, 50, 50_000
# speeds go so far beyond the third quartile of those that are not 0
JUNK = 5.0
# a leg that differs so much from the usual one has a wrong number or a wrong fix in it
ODD = 1.5
# a knot is 15 % more than a mile an hour
NEAR, FITS = 0.06, 0.02
PLACES = ("latitude", "longitude")


def known_columns(log: LogFile, told: Said) -> list[Column]:
    """The columns of a log that are known, with the unit of each speed that was assumed as the way between the fixes shows it.

    Raises ValueError for one that was named, or names its unit, and is not as said.
    """
    columns = columns_of(log, told)
    return shown_by(LogColumns(log, columns), LogColumns(log, columns), told)


def shown_by(fixes: LogColumns, each: LogColumns, told: Said) -> list[Column]:
    """The columns of a log, with the unit of each speed that was assumed as the way between the fixes, of a log, shows it.

    Raises ValueError for a unit that is not the one of a column's name.
    """
    if not {"time", *PLACES} <= {column.field for column in fixes.columns} or not each.of("time"):
        return each.columns
    return [
        _shown(fixes, each, column) if _is_speed(column) and column.field not in told.units else column
        for column in each.columns
    ]


def _is_speed(column: Column) -> bool:
    return column.unit in UNITS and UNITS[column.unit].quantity == "speed"


def _shown(fixes: LogColumns, each: LogColumns, column: Column) -> Column:
    """A column whose unit was assumed, with the one that the places show. Raises ValueError where they contradict its name."""
    ratio = _metres_by_number(fixes, PLACES, each, column)
    if math.isnan(ratio):
        return column
    unit = _unit_of(ratio)
    if not column.why.endswith(ASSUMED):
        (time,) = each.of("time")
        if time.why.endswith(ASSUMED) and _off(1000.0 * ratio, column.unit) <= NEAR:
            raise ValueError(f"time: by the places and the speeds its column {time.name} is in ms: say --unit time=ms")
        _check(fixes, each, column, ratio, unit)
        return column
    if unit is None:
        return replace(column, why=f"{column.why}; the places show {ratio:.2g} m/s for each 1: say --unit {column.field}=UNIT")
    return replace(column, unit=unit, why=f"{column.why.removesuffix(ASSUMED)}, {unit} as the places show")


def _unit_of(ratio: float) -> str | None:
    """The usual unit of so many m/s; None where it is none's, as where places or numbers are not good throughout."""
    unit = min(USUAL, key=lambda each: _off(ratio, each))
    return unit if _off(ratio, unit) <= NEAR else None


def _off(ratio: float, unit: str) -> float:
    return abs(math.log(ratio / UNITS[unit].factor))


def _check(fixes: LogColumns, each: LogColumns, column: Column, ratio: float, shown: str | None) -> None:
    """Raises ValueError where the places show another unit than the column's name."""
    if _off(ratio, column.unit) <= NEAR:
        return
    if _off(_metres_by_number(fixes, PLACES[::-1], each, column), column.unit) <= FITS:
        names = {place.field: place.name for place in fixes.of(*PLACES)}
        say = f"--column latitude={names['longitude']} --column longitude={names['latitude']}"
        raise ValueError(f"latitude, longitude: by the speeds in {column.name} the two are exchanged: say {say}")
    if shown is not None:
        contradiction = f"the column {column.name} is in {column.unit} by its name, but the places show {shown}"
        raise ValueError(f"{column.field}: {contradiction}: say which with --unit {column.field}=UNIT")


def _metres_by_number(fixes: LogColumns, places: Sequence[str], each: LogColumns, column: Column) -> float:
    """The way between fixes in metres, divided by the integral of the numbers over the same time; NaN where there is no way."""
    rows = _numbers(each, [column])
    first = next(rows, None)
    if first is None:
        return math.nan
    ends_s, way_m = _legs(fixes, places, first[0])
    if not len(ends_s):
        return math.nan
    numbers = [first]
    while numbers[-1][0] < ends_s[-1] and (row := next(rows, None)) is not None:
        numbers.append(row)
    at_s, number = _without_junk(np.array(numbers)).T
    if len(at_s) < 2:
        return math.nan
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (number[1:] + number[:-1]) * np.diff(at_s))])
    known = ends_s <= at_s[-1]
    told, way_m = np.diff(np.interp(ends_s[known], at_s, integral)), way_m[known][1:]
    moves = told > 0.0
    if np.count_nonzero(moves) < LEAST_LEGS:
        return math.nan
    told, way_m = told[moves], way_m[moves]
    usual = np.abs(np.log(way_m / told / np.median(way_m / told))) <= math.log(ODD)
    if np.count_nonzero(usual) < LEAST_LEGS:
        return math.nan
    return float(way_m[usual].sum() / told[usual].sum())


def _without_junk(numbers: Array) -> Array:
    """Times and numbers (n, 2), these without signs, where they are not far beyond what most are: 99999 stands for none."""
    number = np.abs(numbers[:, 1])
    moving = number[number > 0.0]
    most = JUNK * float(np.percentile(moving, 75.0)) if len(moving) else 0.0
    return np.column_stack([numbers[:, 0], number])[number <= most]


def _legs(fixes: LogColumns, places: Sequence[str], from_s: float) -> tuple[Array, Array]:
    """Legs between fixes: when each ends, and its way in metres, 0 for the first; `places`: fields of latitude, longitude."""
    of = {known.field: known for known in fixes.columns}
    factors = [of[place].factor for place in places]
    ends: list[tuple[float, float]] = []
    anchor: list[float] | None = None
    for t_s, *place in _numbers(fixes, [of[place] for place in places]):
        if t_s < from_s:
            continue
        at = [number * factor for number, factor in zip(place, factors, strict=True)]
        leg_m = 0.0 if anchor is None else math.hypot(*north_east_m(*anchor, *at))
        if anchor is None or leg_m >= LEG_M:
            ends.append((t_s, leg_m))
            anchor = at
        if len(ends) > MOST_LEGS:
            break
    ends_s, way_m = np.array(ends).reshape(-1, 2).T
    return ends_s, way_m


def _numbers(each: LogColumns, columns: Sequence[Column]) -> Iterator[list[float]]:
    """Time and the numbers of some columns, of each row that has all, in order of increasing times."""
    (time,) = each.of("time")
    assert time.time is not None
    names = [*([time.date] if time.date else []), time.name, *(column.name for column in columns)]
    latest_s = -math.inf
    for _, cells in islice(each.log.rows(names), MOST_ROWS):
        when, texts = cells[: -len(columns)], cells[-len(columns) :]
        try:
            t_s = time.time.seconds(" ".join(when)) + time.ahead_s
        except ValueError:
            continue
        row = [t_s, *(each.log.number(text) for text in texts)]
        if t_s > latest_s and all(map(math.isfinite, row)):
            yield row
            latest_s = t_s
